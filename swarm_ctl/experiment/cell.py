"""A cell of an experiment: the keys that its file may say, and what the engine makes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.world import World, load_world
from swarm_ctl.errors import MissionError
from swarm_ctl.experiment import batch
from swarm_ctl.experiment.room import Room
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.sections import Section, cross_check

METRICS = ("coverage_percent", "time_s", "victims_found", "collisions", "energy_kwh")
"""What the paper's Tables II and III list."""
KNEE_M = 0.3
"""A solid whose lower face is higher than this is over a ground robot's head."""
_OF_EXPLORE = ("message_loss", "odometry_drift", "position_noise_m", "beam_m")
"""Keys of a cell that mean something to kind `explore` only."""
_OF_3D = ("climb_m_s", "start_height_m")
"""Keys of a cell that mean something in three dimensions only."""


class Paper(Section):
    """The paper's figures for one cell; none where it gives none."""

    coverage_percent: float | None = None
    """Share of the area, %."""
    time_s: float | None = None
    """Time taken, s."""
    victims_found: float | None = None
    """Victims found."""
    collisions: float | None = None
    """Collision count."""
    energy_kwh: float | None = None
    """Energy of all robots, kWh."""


class Energy(Section):
    """A ground robot of about 20 kg; our assumption, the paper gives no model."""

    base_w: float = Field(default=20.0, ge=0.0)
    """Computer, sensors and radio of one robot, W."""
    drive_j_m: float = Field(default=20.0, ge=0.0)
    """Driving, J per metre: rolling resistance 0.05 x 20 kg x 9.81 m/s2, half of it lost on the
    way from battery to wheel."""

    def kwh(self, robots: int, time_s: float, path_m: float) -> float:
        """Give the energy of a swarm from its common path."""
        return (robots * time_s * self.base_w + path_m * self.drive_j_m) / 3.6e6


class Cell(Section):
    """One configuration whose trials are averaged."""

    name: str = Field(min_length=1, max_length=60)
    """Unique in the experiment."""
    figure: str = ""
    """Where the paper shows it, as `Fig. 3`."""
    quote: str = ""
    """The paper's sentence that this cell takes at its word."""
    world: Path
    """World file, relative to the experiment file; boxes and walls must lie along x and y."""
    vehicles: int = Field(default=10, ge=1, le=250)
    """Number of robots."""
    duration_s: float = Field(default=600.0, gt=0.0, le=86_400.0)
    """Time explored, s."""
    speed_m_s: float = Field(default=0.2, gt=0.0)
    """Greatest speed, m/s; in 3-D over ground."""
    climb_m_s: float | None = Field(default=None, gt=0.0)
    """Greatest climb and descent in 3-D, m/s; none: `speed_m_s`."""
    start_m: Annotated[tuple[float, float] | None, Field(strict=False)] = None
    """Where all start, x east and y north; none: each anywhere, by the seed."""
    start_jitter_m: float = Field(default=0.01, ge=0.0)
    """Standard deviation of the starts around `start_m`, m."""
    start_spacing_m: float = Field(default=0.0, ge=0.0)
    """Distance between neighbours in a row along x with `start_m` in its middle, m; 0: no row."""
    start_height_m: float | None = Field(default=None, gt=0.0)
    """Height of all starts in 3-D, m; none: any, each its own, by the seed."""
    body_m: float = Field(default=0.6, gt=0.0)
    """Edge of the square robot, in 3-D of the cube, m; what is under it is explored."""
    footprint: Literal["square", "disc"] = "square"
    """What is explored: a square, or the disc inside it; in 3-D always a sphere."""
    footprint_m: float | None = Field(default=None, gt=0.0)
    """Half the width of what is explored, m; none: with `explore` what its memory takes for seen
    (`planner.footprint_m`), else half of `body_m`."""
    radio_m: float | None = Field(default=None, ge=0.0)
    """Range of the radio, m; none: the world's."""
    failures: int = Field(default=0, ge=0)
    """Robots that stop for ever, each at a time between 10 % and 75 % of the duration."""
    message_loss: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of beacons and payloads that each receiver in range misses (`explore`)."""
    odometry_drift: float = Field(default=0.0, ge=0.0, le=1.0)
    """Error of the odometry as a share of the distance, 0.01 for 1 % (`explore`): a slowly turning
    bias, and a heading that walks by as many degrees per sqrt(10 m)."""
    position_noise_m: float = Field(default=0.0, ge=0.0)
    """Standard deviation of where a peer is seen along each axis, m (`explore`)."""
    beam_m: float | None = Field(default=None, gt=0.0)
    """How far the beams see walls for the memory, m (`explore`); none: 1 m, or
    `planner.avoid_distance_m` if that is more."""
    planner: PlannerParams = PlannerParams()
    """How a robot decides."""
    energy: Energy = Energy()
    """What a robot draws."""
    paper: Paper = Paper()
    """The paper's figures."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        planner, given = self.planner, self.model_fields_set
        for key in (*_OF_EXPLORE, *_OF_3D):
            if key in given and key in _OF_EXPLORE and planner.kind != "explore":
                raise cross_check(key, f"is for planner.kind explore only, not for {planner.kind}")
            if key in given and key in _OF_3D and planner.dimensions != 3:
                raise cross_check(key, "is for planner.dimensions 3 only, not for 2")
        if "footprint" in given and planner.dimensions == 3:
            raise cross_check(
                "footprint", "is for planner.dimensions 2 only: in 3-D it is a sphere"
            )
        if self.start_spacing_m and self.start_m is None:
            raise cross_check("start_spacing_m", "needs start_m, the middle of the row")
        if self.failures > self.vehicles:
            reason = f"must be at most vehicles, {self.vehicles}, not {self.failures}"
            raise cross_check("failures", reason)
        if self.beam_m is not None and self.beam_m < planner.avoid_distance_m:
            reason = f"must be at least planner.avoid_distance_m, {planner.avoid_distance_m:g}"
            raise cross_check("beam_m", f"{reason}, not {self.beam_m:g}")
        if planner.period_s > self.duration_s:
            raise cross_check("duration_s", "must be at least planner.period_s")
        return self


def case_of(cell: Cell, sample_s: float, path: Path, key: str) -> batch.Case:
    """Turn a cell into what the engine runs; MissionError for a world that it cannot."""
    if not cell.world.is_file():
        raise MissionError(path, f"{key}.world", f"there is no world file {cell.world}")
    try:
        world = load_world(cell.world)
    except MockVehicleError as error:
        raise MissionError(path, f"{key}.world", str(error)) from error
    period_s = cell.planner.period_s
    case = batch.Case(
        field=_field(world, cell.planner.dimensions, path, f"{key}.world"),
        planner=cell.planner,
        robots=cell.vehicles,
        steps=round(cell.duration_s / period_s),
        sample_steps=max(1, round(sample_s / period_s)),
        speed_m_s=cell.speed_m_s,
        climb_m_s=cell.climb_m_s,
        start_m=None if cell.start_m is None else (cell.start_m[1], cell.start_m[0]),
        start_spacing_m=cell.start_spacing_m,
        start_height_m=cell.start_height_m,
        jitter_m=cell.start_jitter_m,
        radio_m=world.spec.radio.radius_m if cell.radio_m is None else cell.radio_m,
        body_m=cell.body_m,
        footprint=cell.footprint,
        footprint_m=_footprint_m(cell),
        failures=cell.failures,
        message_loss=cell.message_loss,
        odometry_drift=cell.odometry_drift,
        position_noise_m=cell.position_noise_m,
        beam_m=cell.beam_m,
    )
    if misfit := Room(case).misfit:
        where = {
            "world": "anywhere",
            "start_m": f"at {cell.start_m}",
            "start_height_m": f"at a height of {cell.start_height_m} m",
        }[misfit]
        reason = f"a robot of {cell.body_m:g} m does not fit {where} in {cell.world}"
        raise MissionError(path, f"{key}.{misfit}", reason)
    return case


def _footprint_m(cell: Cell) -> float | None:
    if cell.footprint_m is None and cell.planner.kind == "explore":
        return cell.planner.footprint_m
    return cell.footprint_m


def _field(world: World, dimensions: int, path: Path, key: str) -> batch.Field:
    """Take from a world what the engine knows: a rectangle or hall with boxes along its axes."""
    if world.spec.map is not None:
        raise MissionError(path, key, f"{world.path}: the batch engine knows no maps")
    if dimensions == 3 and world.ceiling_m is None:
        raise MissionError(
            path, key, f"{world.path}: has no ceiling_m, which planning in 3-D needs"
        )
    boxes = []
    for polygon in world.outline()["polygons"]:
        if dimensions == 2 and polygon["bottom_m"] > KNEE_M:
            continue
        corners = np.array(polygon["points_ne_m"])
        low, high = corners.min(axis=0), corners.max(axis=0)
        if np.minimum(np.abs(corners - low), np.abs(corners - high)).max() > 1e-6:
            reason = f"{world.path}: the batch engine knows only boxes and walls along x and y"
            raise MissionError(path, key, reason)
        low_m, high_m = [*low.tolist(), -polygon["top_m"]], [*high.tolist(), -polygon["bottom_m"]]
        boxes.append((*low_m[:dimensions], *high_m[:dimensions]))
    return batch.Field(
        low_m=tuple(world.low_ned_m.tolist()[:dimensions]),
        high_m=tuple(world.high_ned_m.tolist()[:dimensions]),
        boxes_m=tuple(boxes),
        victims_m=tuple(victim.position_ned_m[:dimensions] for victim in world.victims),
        cell_m=world.spec.coverage.cell_m,
    )
