"""The world that autopilots' simulators lack: walls and each other for rangefinders, and a radio.

It knows where the vehicles truly are, casts the mock's rays from there and speaks as rangefinders
on their second links; carries what one companion broadcasts to the others within the radio's
radius, and tells their ranges and bearings, as the vehicles' own radios would.
"""

from __future__ import annotations

import contextlib
import math
import select
import threading
import time
from collections import Counter, deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from sitl.simulators import Simulator

from mock_vehicle.autopilot.ranging import quaternion_to
from mock_vehicle.coverage import Coverage
from mock_vehicle.radio import Radio
from mock_vehicle.referee import PAIR_TOUCH_M, WALL_TOUCH_M, Contacts
from mock_vehicle.sensors.rangefinder import RANGE_MIN_M, RING, Rangefinders, Ranges
from mock_vehicle.world import load_world
from mock_vehicle.world.radio import RadioSpec
from swarm_ctl import wire

Floats = NDArray[np.float64]
Angles = tuple[float, float, float]

RADIO, COMPANION, RANGEFINDER, VISION, STRANGER = 68, 191, 173, 197, (254, 190)
ORIENTATIONS = {"px4": (0, 12, 6, 2, 24, 25), "ardupilot": (0, 4, 6, 2, 24, 25)}
"""Front, back, left, right, up, down."""
PERIOD_S, BEAT_S, TRUTH_HZ = 0.1, 0.5, 30.0
GAP_S = 0.005
"""PX4 has room for two frames that are to be passed on: of those that come faster it drops most."""
AIRBORNE_M = 0.3
EARTH_M = 111_319.49
"""Of a degree of latitude."""
LOCAL_NED, NAIVE = 1, 1
LASER, UNKNOWN_KIND, CUSTOM, BODY_FRD, SET_INTERVAL = 0, 4, 100, 12, 511
NOT_TURNED = (0.0, 0.0, 0.0, 0.0)

_HEARTBEAT, _COMMAND = wire.message("HEARTBEAT"), wire.message("COMMAND_LONG")
_DISTANCE, _SCAN = wire.message("DISTANCE_SENSOR"), wire.message("OBSTACLE_DISTANCE")
_TUNNEL, _ODOMETRY = wire.message("TUNNEL"), wire.message("ODOMETRY")
_TRUTH = {"px4": wire.message("HIL_STATE_QUATERNION"), "ardupilot": wire.message("SIM_STATE")}
_HEARD = (_HEARTBEAT, _TUNNEL, *_TRUTH.values())


class Outlet:
    """One vehicle's second link: what it truly does, and what waits to be told to it."""

    def __init__(self, vehicle: Simulator) -> None:
        self.vehicle = vehicle
        self.offset_ned_m = np.zeros(3)
        """From where it stood first."""
        self.attitude_rad: Angles = (0.0, 0.0, 0.0)
        self.told_s = -math.inf
        self.relayed: deque[bytes] = deque()
        self.sensed: deque[bytes] = deque()
        self.parser = wire.Parser(_HEARD)
        self._first: tuple[float, float, float] | None = None
        self._address: Any = None
        self._numbers: Counter[int] = Counter()
        vehicle.station.setblocking(False)
        if vehicle.autopilot == "px4":
            self._address = vehicle.station.getpeername()

    def drain(self) -> list[wire.Frame]:
        """Give what the vehicle said."""
        frames: list[wire.Frame] = []
        with contextlib.suppress(OSError):
            while True:
                data, self._address = self.vehicle.station.recvfrom(4096)
                frames += self.parser.feed(data)
        return [frame for frame in frames if frame.sysid == self.vehicle.sysid]

    def take_truth(self, values: Any, now: float) -> None:
        """Note where it truly is."""
        if self.vehicle.autopilot == "px4":
            w, x, y, z = values.attitude_quaternion
            self.attitude_rad = _angles(w, x, y, z)
            place = values.lat * 1e-7, values.lon * 1e-7, values.alt * 1e-3
        else:
            self.attitude_rad = values.roll, values.pitch, values.yaw
            place = values.lat_int * 1e-7, values.lon_int * 1e-7, values.alt
        self._first = self._first or place
        north, east, up = (now_ - then for now_, then in zip(place, self._first, strict=True))
        shrink = math.cos(math.radians(place[0]))
        self.offset_ned_m = np.array([north * EARTH_M, east * EARTH_M * shrink, -up])
        self.told_s = now

    def tell_place(self, values: Any) -> None:
        """Tell PX4 where it is and how it moves, as a motion capture system does.

        Its simulated GNSS is wrong by up to 0.5 m/s, which no distance to a wall makes up for.
        """
        velocity = [speed * 1e-2 for speed in (values.vx, values.vy, values.vz)]
        place = self.offset_ned_m.tolist()
        frames, no_rates, no_matrices = (LOCAL_NED, LOCAL_NED), (0.0,) * 3, ([0.0] * 21,) * 2
        turned = values.attitude_quaternion
        told = (0, *frames, *place, turned, *velocity, *no_rates, *no_matrices, 0, NAIVE, 100)
        self.send(self.pack(_ODOMETRY, VISION, *told))

    def pack(self, message: wire.Message, compid: int, *values: object) -> bytes:
        """Speak as one of the vehicle's own components."""
        self._numbers[compid] += 1
        return message.pack(self._numbers[compid] & 0xFF, self.vehicle.sysid, compid, *values)

    def greet(self) -> None:
        """Keep the link open, and ask for the truth."""
        number, interval_us = _TRUTH[self.vehicle.autopilot].id, 1e6 / TRUTH_HZ
        ask = (self.vehicle.sysid, 1, SET_INTERVAL, 0, number, interval_us, *[0.0] * 5)
        self.send(_HEARTBEAT.pack(0, *STRANGER, 18, 8, 0, 0, 4, 3))
        self.send(_COMMAND.pack(0, *STRANGER, *ask))

    def send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            if self.vehicle.autopilot == "px4":
                self.vehicle.station.send(data)
            elif self._address is not None:
                self.vehicle.station.sendto(data, self._address)


class Rig:
    """Plays world and radio for some vehicles until it is left, and knows how they did."""

    def __init__(self, world: Path, vehicles: Sequence[Simulator], *, seed: int = 1) -> None:
        self.outlets = [Outlet(one) for one in vehicles]
        self.sysids = [one.sysid for one in vehicles]
        self.world = load_world(world)
        self.starts_ned_m, _ = self.world.starts(len(vehicles), seed)
        self.coverage = Coverage(self.world, self.starts_ned_m)
        rng = np.random.default_rng(seed)
        self._reach_m = self.world.spec.sensors.range_max_m
        self._eyes = Rangefinders(range_max_m=self._reach_m, noise_m=0.0, rng=rng)
        self._radio = Radio(self.sysids, RadioSpec(radius_m=self.world.spec.radio.radius_m), rng)
        self._walls = Contacts(len(vehicles))
        self.apart_m = math.inf
        """Nearest that two ever came in the air, centre to centre."""
        self.wall_m = math.inf
        """Nearest that one ever came to a wall or the ceiling."""
        self.contacts = 0
        """Of two with one another."""
        self._apart_before_m = math.inf
        self.carried: Counter[str] = Counter()
        """Broadcasts taken from each vehicle's companion, and told to others."""
        self.track: list[tuple[float, Floats]] = []
        """Where all truly were, (n, 3) NED in the world, at times of the monotonic clock."""
        self._ends = threading.Event()
        self._ticks = 0
        self._thread = threading.Thread(target=self._live, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    @property
    def wall_contacts(self) -> int:
        return self._walls.count

    @property
    def knows_all(self) -> bool:
        """Whether every vehicle has told where it truly is."""
        return all(outlet.told_s > -math.inf for outlet in self.outlets)

    def _live(self) -> None:
        now = time.monotonic()
        beat_s = tick_s = send_s = now
        while not self._ends.is_set():
            sockets = [outlet.vehicle.station for outlet in self.outlets]
            select.select(sockets, [], [], max(0.0, send_s - now))
            now = time.monotonic()
            self._listen(now)
            if now >= beat_s:
                beat_s = now + BEAT_S
                for outlet in self.outlets:
                    outlet.greet()
            if now >= tick_s:
                tick_s += PERIOD_S
                self._tick(now)
            if now >= send_s:
                send_s = now + GAP_S
                self._speak()

    def _listen(self, now: float) -> None:
        for index, outlet in enumerate(self.outlets):
            for frame in outlet.drain():
                if frame.compid == COMPANION and frame.id in {_HEARTBEAT.id, _TUNNEL.id}:
                    self._radio.send(index, frame.raw, now)
                    self.carried[f"from {frame.sysid}"] += 1
                elif frame.id == _TRUTH[outlet.vehicle.autopilot].id:
                    outlet.take_truth(frame.values, now)
                    if frame.id == _TRUTH["px4"].id:
                        outlet.tell_place(frame.values)
        for hearer, raw in self._radio.carry(now):
            self.outlets[hearer].relayed.append(raw)
            self.carried[f"to {self.sysids[hearer]}"] += 1

    def _speak(self) -> None:
        """Say one frame to each vehicle, first what its peers say."""
        for outlet in self.outlets:
            waiting = outlet.relayed or outlet.sensed
            if waiting:
                outlet.send(waiting.popleft())

    def _tick(self, now: float) -> None:
        """Look around from every vehicle, and note how they do."""
        self._ticks += 1
        place = self.starts_ned_m + np.array([outlet.offset_ned_m for outlet in self.outlets])
        gaps = np.linalg.norm(place[:, None] - place[None, :], axis=2)
        angles = np.array([outlet.attitude_rad for outlet in self.outlets]).T
        self._radio.update(gaps, np.ones(len(place), dtype=bool), place, now)
        seer, seen = np.nonzero(~np.eye(len(place), dtype=bool))
        ranges = self._eyes.measure(self.world, place, angles[2], (seer, seen))
        fixes = self._radio.fixes(place, (angles[0], angles[1], angles[2]), now)
        for index, outlet in enumerate(self.outlets):
            outlet.sensed.clear()
            outlet.sensed.extend(self._readings(outlet, ranges, index))
            if self._ticks % 2:
                outlet.sensed.extendleft(_fix(outlet, *fix[:3]) for fix in fixes[index])
        self.track.append((now, place))
        self._judge(place, gaps, now)

    def _readings(self, outlet: Outlet, ranges: Ranges, index: int) -> list[bytes]:
        nearest, farthest = round(RANGE_MIN_M * 100), round(self._reach_m * 100)

        def centimetres(metres: float) -> int:
            return round(metres * 100.0) if metres <= self._reach_m else farthest + 1

        orientations = ORIENTATIONS[outlet.vehicle.autopilot]
        frames = [
            outlet.pack(
                *(_DISTANCE, RANGEFINDER, 0, nearest, farthest, centimetres(metres), LASER),
                *(number, orientation, 255, 0.0, 0.0, NOT_TURNED, 0),
            )
            for number, (metres, orientation) in enumerate(
                zip(ranges.sensors_m[index].tolist(), orientations, strict=True)
            )
        ]
        if self._ticks % 2:
            ring = [centimetres(metres) for metres in ranges.ring_m[index].tolist()]
            scan = (0, LASER, ring, 360 // RING, nearest, farthest, 360.0 / RING, 0.0, BODY_FRD)
            frames.append(outlet.pack(_SCAN, RANGEFINDER, *scan))
        return frames

    def _judge(self, place: Floats, gaps: Floats, now: float) -> None:
        is_up = place[:, 2] < -AIRBORNE_M
        self.coverage.cover(place, is_up, now)
        clear_m = self.world.clearance(place)
        self._walls.observe(clear_m, WALL_TOUCH_M, is_up)
        self.wall_m = min(self.wall_m, float(clear_m[is_up].min(initial=math.inf)))
        among = gaps[is_up][:, is_up]
        apart_m = float(among[~np.eye(len(among), dtype=bool)].min(initial=math.inf))
        self.contacts += apart_m < PAIR_TOUCH_M <= self._apart_before_m
        self._apart_before_m = apart_m
        self.apart_m = min(self.apart_m, apart_m)


def _fix(
    outlet: Outlet, sysid: int, range_m: float, direction: tuple[float, float, float]
) -> bytes:
    """Say where the radio hears a peer."""
    turn = quaternion_to(*direction)
    measured = (0, 0, 0xFFFF, round(range_m * 100.0), UNKNOWN_KIND, sysid, CUSTOM, 255, 0.0, 0.0)
    return outlet.pack(_DISTANCE, RADIO, *measured, turn, 0)


def _angles(w: float, x: float, y: float, z: float) -> Angles:
    """Turn a quaternion into roll, pitch, yaw."""
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
