"""The one who knows the truth: coverage, victims, collisions, energy, tracks."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mock_vehicle.coverage import Coverage

if TYPE_CHECKING:
    from mock_vehicle.sensors.battery import Batteries
    from mock_vehicle.vehicle import Vehicle
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]
Files = dict[str, dict[str, Any]]
"""By name: the arrays of an .npz, the JSON values of a .json."""

COVER_EVERY = 2
"""Coverage is looked at every second tick: 5 Hz."""
CURVE_S = 1.0
TRACK_S = 0.5
WALL_TOUCH_M = 0.3
"""Body radius: closer to a wall is a collision."""
PAIR_TOUCH_M = 0.6
TOLERANCE_M = 0.001
PARTED_M = 0.1
"""How far beyond touching a contact ends; until then it is one collision."""
STREAM_S = 1.0
"""Longer gaps between setpoints are another stream, not jitter."""
SETPOINT_S = 0.1
UNCOUNTED: Mapping[str, float | None] = {"redundant_fraction": None, "vehicles_per_cell": None}


class Contacts:
    """Counts each contact once, until the two have parted again."""

    def __init__(self, size: int) -> None:
        self._touching = np.zeros(size, dtype=bool)
        self.count = 0
        self.lasts = False
        """Whether anybody has not parted yet."""

    def observe(self, gap_m: FLOATS, touch_m: float, counts: BOOLS) -> None:
        """Look at the gaps of all; only where `counts` may a contact begin."""
        begins = (gap_m < touch_m - TOLERANCE_M) & counts & ~self._touching
        self.count += int(np.count_nonzero(begins))
        self._touching |= begins
        self._touching &= gap_m <= touch_m + PARTED_M
        self.lasts = bool(np.count_nonzero(self._touching))


class Rows:
    """Rows of one shape that grow in number, as bytes: objects would take ten times as much."""

    def __init__(self, dtype: DTypeLike, *shape: int) -> None:
        self._dtype, self._shape, self._count = np.dtype(dtype), shape, 0
        self._bytes = bytearray()

    def add(self, row: ArrayLike) -> None:
        """Add one."""
        self._bytes += np.asarray(row, self._dtype).tobytes()
        self._count += 1

    def array(self) -> NDArray[Any]:
        """Give a copy of all, (count, *shape)."""
        rows = np.frombuffer(bytes(self._bytes), self._dtype)
        return rows.reshape(self._count, *self._shape)


class Referee:
    """Watches the whole fleet; no vehicle and no controller hears of it."""

    def __init__(
        self,
        world: World,
        vehicles: Sequence[Vehicle],
        batteries: Batteries,
        starts_ned_m: FLOATS,
    ) -> None:
        n, victims = len(vehicles), len(world.victims)
        self._world, self._vehicles, self._batteries = world, vehicles, batteries
        self._starts_ned_m = starts_ned_m
        self.coverage = Coverage(world, starts_ned_m)
        self._walls = Contacts(n)
        self._pairs: set[tuple[int, int]] = set()
        """Who touches whom now."""
        self._pair_collisions = 0
        self.min_separation_m = math.inf
        self.path_length_m = np.zeros(n)
        self.victim_found_s = np.full(victims, np.nan)
        self.victim_found_by = np.zeros(victims, dtype=np.int64)
        """sysid of the first to see it; 0 is nobody."""
        self._position_ned_m = starts_ned_m.copy()
        self._airborne = np.zeros(n, dtype=bool)
        self._now = 0.0
        self._ticks = 0
        self.keeps_tracks = True
        """Whether it remembers what is to be written of every moment, as tracks and the curve."""
        self._curve = Rows(np.float64, 2)
        """Time, and the share that was seen by then."""
        self._track_s = Rows(np.float64)
        self._track_ned_m, self._airborne_then = Rows(np.float32, n, 3), Rows(np.bool_, n)
        """At each time of the track: where everybody was, who was airborne."""
        self._next_s = {"curve": -math.inf, "track": -math.inf}
        self._pair_of = np.triu_indices(n, 1)
        self._links = Rows(np.uint8, -(len(self._pair_of[0]) // -8))
        """At each time of the curve: which pairs hear each other, packed as bits."""

    @property
    def collisions(self) -> int:
        """Episodes of contact with walls and with one another."""
        return self._walls.count + self._pair_collisions

    @property
    def wall_contacts(self) -> int:
        """Episodes of contact with walls."""
        return self._walls.count

    @property
    def is_wall_touched(self) -> bool:
        """Whether anybody touches a wall, or has not parted from it yet."""
        return self._walls.lasts

    @property
    def energy_kwh(self) -> float:
        """Drawn from all batteries."""
        return float(self._batteries.energy_j.sum() / 3.6e6)

    def observe_walls(self, clearance_m: FLOATS, airborne: BOOLS) -> None:
        """Count who newly touches a wall; `inf` clearance is far away."""
        self._walls.observe(clearance_m, WALL_TOUCH_M, airborne)

    def observe_pairs(self, pairs: list[tuple[int, int]], gap_m: FLOATS, counts: BOOLS) -> None:
        """Count pairs that newly touch; pairs that are not named are far apart."""
        touching: set[tuple[int, int]] = set()
        for pair, gap, may_begin in zip(pairs, gap_m.tolist(), counts.tolist(), strict=True):
            if pair in self._pairs:
                if gap <= PAIR_TOUCH_M + PARTED_M:
                    touching.add(pair)
            elif may_begin and gap < PAIR_TOUCH_M - TOLERANCE_M:
                touching.add(pair)
                self._pair_collisions += 1
        self._pairs = touching

    def sample(
        self,
        now: float,
        position_ned_m: FLOATS,
        airborne: BOOLS,
        distances_m: FLOATS,
        sightings: tuple[INDICES, ...],
        linked: BOOLS,
    ) -> None:
        """Look at the fleet once per tick; `linked[a, b]` says that b hears a."""
        self._now = now
        step = position_ned_m - self._position_ned_m
        self.path_length_m += np.sqrt(np.einsum("ij,ij->i", step, step))
        self._position_ned_m = position_ned_m.copy()
        self._airborne = airborne
        among = distances_m[airborne][:, airborne]
        np.fill_diagonal(among, math.inf)
        self.separate(among)
        self._find(now, sightings)
        if self._ticks % COVER_EVERY == 0:
            self.coverage.cover(position_ned_m, airborne, now)
        self._ticks += 1
        if self.keeps_tracks:
            self._keep(now, linked)

    def snapshot(self) -> dict[str, Any]:
        """Say how the run goes, in JSON values."""
        return {
            "time_s": round(self._now, 3),
            "coverage_fraction": round(self.coverage.fraction, 5),
            "victims_found": int(np.count_nonzero(self.victim_found_by)),
            "victims_total": len(self._world.victims),
            "collisions": self.collisions,
            "min_separation_m": _finite(self.min_separation_m),
            "airborne": int(np.count_nonzero(self._airborne)),
            "vehicles": [
                {"sysid": vehicle.sysid, "alive": vehicle.alive, "armed": vehicle.armed}
                for vehicle in self._vehicles
            ],
        }

    def _sight_radius_m(self) -> float | None:
        """Half of the width that is seen of a floor; none where space is counted."""
        coverage = self._world.spec.coverage
        return None if coverage.footprint == "sphere" else coverage.radius_m

    def _volume(self) -> dict[str, float]:
        """Tell how much air there is to see, and how far around itself a vehicle sees it."""
        spec, grid = self._world.spec.coverage, self.coverage
        if spec.footprint != "sphere":
            return {}
        volume_m3 = float(grid.free.sum()) * grid.cell_m**3
        return {"searchable_m3": round(volume_m3, 3), "ball_radius_m": spec.radius_m}

    def truth(self, *, so_far: bool = False) -> dict[str, Any]:
        """Collect all scalars and short lists, in JSON values."""
        return {
            **self.snapshot(),
            "world": self._world.name,
            "sight_radius_m": self._sight_radius_m(),
            **self._volume(),
            "path_length_m": float(self.path_length_m.sum()),
            "path_lengths_m": self.path_length_m.tolist(),
            "energy_kwh": self.energy_kwh,
            "battery_fractions": self._batteries.fraction.tolist(),
            "wall_collisions": self._walls.count,
            "pair_collisions": self._pair_collisions,
            "setpoint_jitter_p99_ms": self.setpoint_jitter_p99_ms(),
            **(UNCOUNTED if so_far else self._redundancy()),
            "coverage_curve": self._curve.array().tolist(),
            "victims": [
                {
                    "name": victim.name,
                    "position_ned_m": np.asarray(victim.position_ned_m).tolist(),
                    "found_s": _finite(float(found_s)),
                    "found_by": int(found_by) or None,
                }
                for victim, found_s, found_by in zip(
                    self._world.victims, self.victim_found_s, self.victim_found_by, strict=True
                )
            ],
        }

    def setpoint_jitter_p99_ms(self) -> float | None:
        """99th percentile of |interval between setpoints - 100 ms|; none without a stream."""
        intervals = [np.diff(np.fromiter(v.setpoint_times, float)) for v in self._vehicles]
        streamed = np.concatenate(intervals) if intervals else np.empty(0)
        streamed = streamed[streamed < STREAM_S]
        if not len(streamed):
            return None
        return float(np.percentile(np.abs(streamed - SETPOINT_S), 99) * 1e3)

    def files(self, *, so_far: bool = False) -> Files:
        """Give the content of truth.json, truth.npz and world.json; it changes no more.

        Of a flight `so_far` nobody counts who saw what: that takes the longer the longer it is.
        """
        return {
            "world.json": self._world.outline(),
            "truth.npz": self._arrays(),
            "truth.json": self.truth(so_far=so_far),
        }

    def write_world(self, folder: Path) -> None:
        """Write world.json, which stays as it is."""
        write_files(folder, {"world.json": self._world.outline()})

    def separate(self, distances_m: FLOATS) -> None:
        """Note how near any two come of whom both fly, by their distances in m."""
        self.min_separation_m = min(self.min_separation_m, float(distances_m.min(initial=math.inf)))

    def _keep(self, now: float, linked: BOOLS) -> None:
        """Remember where everybody is, how much was seen, and who hears whom, when it is time."""
        if now >= self._next_s["track"]:
            self._next_s["track"] = now + TRACK_S - 1e-6
            self._track_s.add(now)
            self._track_ned_m.add(self._position_ned_m)
            self._airborne_then.add(self._airborne)
        if now >= self._next_s["curve"]:
            self._next_s["curve"] = now + CURVE_S - 1e-6
            self._curve.add((now, self.coverage.fraction))
            first, second = self._pair_of
            self._links.add(np.packbits(linked[first, second] & linked[second, first]))

    def _find(self, now: float, sightings: tuple[INDICES, ...]) -> None:
        for vehicle, victim in zip(*(column.tolist() for column in sightings), strict=True):
            if not self.victim_found_by[victim]:
                self.victim_found_by[victim] = self._vehicles[vehicle].sysid
                self.victim_found_s[victim] = now

    def _redundancy(self) -> Mapping[str, float | None]:
        """Tell how much was seen by several vehicles that one would have been enough for."""
        seers = self.coverage.seers(self._track_ned_m.array(), self._airborne_then.array())
        seers = seers[seers > 0]
        if not len(seers):
            return UNCOUNTED
        return {
            "redundant_fraction": round(float((seers > 1).mean()), 5),
            "vehicles_per_cell": round(float(seers.mean()), 4),
        }

    def _arrays(self) -> dict[str, Any]:
        grid = self.coverage
        seen = ~np.isnan(grid.seen_s)
        columns = grid.free.sum(axis=0)
        victims = [victim.position_ned_m for victim in self._world.victims]
        curve = self._curve.array()
        return {
            "track_time_s": self._track_s.array(),
            "track_ned_m": self._track_ned_m.array(),
            "coverage_time_s": curve[:, 0],
            "coverage_fraction": curve[:, 1],
            "links": self._links.array(),
            "seen_s": np.fmin.reduce(grid.seen_s, axis=0),
            "seen_fraction": seen.sum(axis=0) / np.maximum(columns, 1),
            "free": grid.free.any(axis=0),
            "blocked": grid.blocked.all(axis=0),
            "cell_m": np.array(grid.cell_m),
            "origin_ne_m": grid.origin_ne_m,
            "victims_ned_m": np.array(victims, dtype=np.float64).reshape(-1, 3),
            "victim_found_s": self.victim_found_s.copy(),
            "victim_found_by": self.victim_found_by.copy(),
            "starts_ned_m": self._starts_ned_m,
            "sysids": np.array([vehicle.sysid for vehicle in self._vehicles]),
        }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_files(folder: Path, files: Files, *, small: bool = True) -> None:
    """Write files of the truth; a reader never sees half of one.

    To make arrays `small` takes longer than all else, and the longer the longer the flight was.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        data = _archive(content, small=small) if name.endswith(".npz") else _json(content)
        draft = folder / f".{name}.part"
        draft.write_bytes(data)
        draft.replace(folder / name)


def _archive(arrays: dict[str, Any], *, small: bool) -> bytes:
    archive = io.BytesIO()
    (np.savez_compressed if small else np.savez)(archive, **arrays)
    return archive.getvalue()


def _json(content: dict[str, Any]) -> bytes:
    return json.dumps(content, allow_nan=False).encode()
