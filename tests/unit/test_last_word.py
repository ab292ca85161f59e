"""Whatever telemetry, peers, planner and operator do: what leaves a controller keeps the limits."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from halls import write_hall
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl import wire
from swarm_ctl.agent import beacon as beacons
from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.blind import FORGOTTEN_M, LATE_S
from swarm_ctl.agent.phases import SILENT, STREAMING, Phase
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.explore.planner import OnePlan
from swarm_ctl.flight import orders_of
from swarm_ctl.mission import load_mission
from swarm_ctl.model import Operator, Vec3

TICK_S = 0.1
SPEED_M_S, CLIMB_M_S, BRAKING_M_S2 = 1.5, 0.8, 2.0
SEPARATION_M, WALL_M, RADIUS_M, FLOOR_M, CEILING_M = 1.0, 0.5, 8.0, 0.4, 3.5
RESPONSE_S, PRESSED_M = 0.6, 0.11
Direction = tuple[float, float, float]
TOLERANCE_M_S = 0.0101
"""What the filter lets pass where limits contradict each other (explore/safety.py)."""
BEAM_BEARINGS_RAD = (0.0, math.pi, -math.pi / 2.0, math.pi / 2.0)
"""Front, back, left and right, clockwise from the heading."""
PX4_MODES = [PX4.offboard_mode, PX4.land_mode, 3 << 16, 4 << 16 | 5 << 24, 0]
COPTER_MODES = [4, 9, 6, 5, 0]
ARMED = 0x80
ORIENTATIONS = (0, 12, 6, 2, 24, 25)

odd = st.sampled_from([math.nan, math.inf, -math.inf, 1e30, -1e30, 0.0])
metres = st.floats(-12.0, 12.0) | odd
near = st.floats(-2.5, 2.5)
speeds = st.floats(-3.0, 3.0)


def mostly(usual: st.SearchStrategy[Any], seldom: st.SearchStrategy[Any]) -> Any:
    """Draw the usual nearly always: a story in which all goes wrong at once ends at once."""
    return st.integers(0, 39).flatmap(lambda draw: seldom if draw == 39 else usual)


@dataclass(frozen=True)
class Step:
    """What reaches the controller between two ticks, each None when nothing does."""

    mode: int | None
    is_armed: bool
    status: int
    moved: tuple[float, float, float]
    """From where it was, in metres."""
    place: tuple[float, float, float] | None
    """Where it is said to be all of a sudden."""
    velocity: tuple[float, float, float]
    yaw: float | None
    ranges_cm: tuple[int, ...] | None
    battery: int | None
    peer: tuple[int, float, float, float] | None
    plan: tuple[float, float, float, float] | None
    order: Operator | None
    noise: bytes


steps = st.builds(
    Step,
    mode=mostly(st.sampled_from([None, 0]), st.sampled_from([1, 2, 3, 4])),
    is_armed=mostly(st.just(True), st.booleans()),
    status=mostly(st.just(4), st.sampled_from([5, 8, 0])),
    moved=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    place=mostly(st.none(), st.tuples(metres, metres, st.floats(-5.0, 1.0) | odd)),
    velocity=mostly(st.tuples(speeds, speeds, speeds), st.tuples(odd, odd, odd)),
    yaw=mostly(st.none() | st.floats(-4.0, 4.0), odd),
    ranges_cm=st.none() | st.tuples(*[st.integers(0, 300)] * 6),
    battery=mostly(st.none(), st.integers(-1, 100)),
    peer=st.none() | st.tuples(st.integers(2, 4), near, near, near),
    plan=mostly(st.tuples(speeds, speeds, speeds, speeds), st.none() | st.tuples(*[odd] * 4)),
    order=mostly(st.none(), st.none() | st.sampled_from(list(Operator))),
    noise=mostly(st.just(b""), st.binary(max_size=40)),
)


@dataclass(frozen=True)
class Plan:
    """What a planner of any temper gives."""

    velocity_m_s: Any
    heading_rad: Any
    target_m: Any
    is_new: Any
    avoiding: Any


class Bench:
    """A controller on the bench, its autopilot played by hand."""

    def __init__(self, folder: Path, *, is_px4: bool, dimensions: int) -> None:
        limits = {"radius_m": RADIUS_M, "floor_m": FLOOR_M, "ceiling_m": CEILING_M}
        limits |= {"separation_m": SEPARATION_M, "wall_m": WALL_M}
        flight = {"height_m": 1.5, "speed_m_s": SPEED_M_S, "climb_m_s": CLIMB_M_S}
        flight |= {"acceleration_m_s2": BRAKING_M_S2}
        planner = {"kind": "lf-pso", "dimensions": dimensions}
        changed = {"limits": limits, "flight": flight, "planner": planner}
        mission = load_mission(write_hall(folder, changed))
        self.agent = Agent(
            1,
            orders_of(mission),
        )
        self.tag = beacons.mission_tag(mission.name)
        self.is_px4, self.is_level = is_px4, dimensions == 2
        self.now = 0.0
        self.out = wire.Parser(("SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG"))
        self.setpoints = 0
        self.place: tuple[float, ...] = (0.0, 0.0, -1.5)

    def hear(self, name: str, *values: object, sysid: int = 1, compid: int = 1) -> None:
        self.agent.receive(wire.message(name).pack(0, sysid, compid, *values), self.now)

    def beat(self, mode: int, *, is_armed: bool, status: int) -> None:
        autopilot, modes = (12, PX4_MODES) if self.is_px4 else (3, COPTER_MODES)
        base_mode = 1 | (ARMED if is_armed else 0)
        self.hear("HEARTBEAT", 2, autopilot, base_mode, modes[mode], status, 3)

    def tell(self, place: tuple[float, ...], velocity: tuple[float, ...]) -> None:
        if all(math.isfinite(value) and abs(value) < 100.0 for value in place):
            self.place = place
        self.hear("LOCAL_POSITION_NED", int(self.now * 1000) + 1, *place, *velocity)

    def see(self, ranges_cm: tuple[int, ...]) -> None:
        for index, (orientation, cm) in enumerate(zip(ORIENTATIONS, ranges_cm, strict=True)):
            self.hear("DISTANCE_SENSOR", 0, 10, 400, cm, 0, index, orientation, 255)

    def take_off(self) -> None:
        """Play a healthy vehicle until it explores."""
        height_m, mode, is_armed = 0.0, 4, False
        while self.agent.phase not in {Phase.EXPLORING, Phase.AVOIDING}:
            assert self.now < 60.0, self.agent.trouble
            if self.agent.phase is Phase.ARMING:
                is_armed, mode = mode == 0, 0
            if self.agent.phase is Phase.TAKEOFF:
                height_m += 0.1
            self.beat(mode, is_armed=is_armed, status=4 if is_armed else 3)
            self.tell((0.0, 0.0, -height_m), (0.0, 0.0, 0.0))
            self.hear("ATTITUDE", int(self.now * 1000) + 1, *[0.0] * 6)
            self.see((500,) * 6)
            self.tick()

    def suffer(self, step: Step) -> None:
        """Let a step happen, then tick."""
        if step.mode is not None:
            self.beat(step.mode, is_armed=step.is_armed, status=step.status)
        place = step.place or tuple(p + m for p, m in zip(self.place, step.moved, strict=True))
        self.tell(place, step.velocity)
        if step.yaw is not None:
            self.hear("ATTITUDE", int(self.now * 1000) + 1, 0.0, 0.0, step.yaw, 0.0, 0.0, 0.0)
        if step.ranges_cm is not None:
            self.see(step.ranges_cm)
        if step.battery is not None:
            self.hear("SYS_STATUS", 0, 0, 0, 0, 0, 0, step.battery, 0, 0, 0, 0, 0, 0)
        if step.peer is not None:
            self.meet(*step.peer, velocity=step.velocity)
        if step.order is not None:
            self.agent.order(step.order, self.now)
        self.agent.receive(step.noise, self.now)
        self.agent._ask = lambda *_: plan_of(step.plan, self.is_level)
        self.tick()

    def meet(
        self, sysid: int, north: float, east: float, down: float, velocity: tuple[float, ...]
    ) -> None:
        """Let the radio measure a peer, and the peer tell of itself."""
        offset = Vec3(north, east, down)
        distance_m = math.hypot(*offset)
        if not 0.0 < distance_m < 600.0:
            return
        x, y, z = (part / distance_m for part in offset)
        turned = (1.0 + x, 0.0, -z, y) if x > -0.999 else (0.0, 0.0, 0.0, 1.0)
        size = math.hypot(*turned)
        quaternion = tuple(part / size for part in turned)
        cm = round(distance_m * 100)
        sensor = (0, 0, 60000, cm, 4, sysid, 100, 255, 0.0, 0.0, quaternion)
        self.hear("DISTANCE_SENSOR", *sensor, compid=68)
        told = Vec3(*(v if math.isfinite(v) and abs(v) < 300.0 else 0.0 for v in velocity))
        here = Vec3(0.0, 0.0, -1.5)
        payload = beacons.encode(beacons.Beacon(self.tag, Phase.EXPLORING, told, here, None, (1,)))
        values = (0, 0, beacons.BEACON_TYPE, len(payload), payload)
        self.hear("TUNNEL", *values, sysid=sysid, compid=191)

    def tick(self) -> None:
        self.now = round(self.now + TICK_S, 3)
        for frame in self.out.feed(self.agent.tick(self.now)):
            if frame.id == wire.message("COMMAND_LONG").id:
                assert self.agent.phase not in SILENT, f"a command while {self.agent.phase}"
            else:
                self.setpoints += 1
                self.check(frame.values)

    def check(self, setpoint: Any) -> None:
        """Hold a setpoint against every limit, computed here anew."""
        agent = self.agent
        assert agent.phase in STREAMING, f"a setpoint while {agent.phase}"
        velocity = (setpoint.vx, setpoint.vy, setpoint.vz)
        assert all(map(math.isfinite, (*velocity, setpoint.yaw)))
        assert setpoint.type_mask == 0x9C7
        assert math.hypot(setpoint.vx, setpoint.vy) <= SPEED_M_S + 1e-5
        assert abs(setpoint.vz) <= CLIMB_M_S + 1e-5
        for name, towards, room_m, braking in self.limits():
            speed = along(velocity, towards)
            most = math.sqrt(2.0 * braking * room_m) if room_m > 0.0 else 0.0
            most += self.pushed_m_s(towards) if name == "peer" else 0.0
            assert speed <= most + TOLERANCE_M_S, f"{speed:.3f} m/s at a {name} {room_m:.3f} m off"

    def pushed_m_s(self, towards: Direction) -> float:
        """Give the most that walls push towards a peer, in half: 0.5 m/s each that is too near.

        They do who come 0.12 m nearer than they may within the time that a vehicle flies on, and
        who are flown at so fast that they tell it to leave at the speed that this would mean.
        """
        flown_m = [RESPONSE_S * v for v in self.agent.telemetry.velocity_ned_m_s]
        near = []
        for name, way, room_m, _ in self.limits():
            ahead_m = max(0.0, along(flown_m, way))
            left_m = room_m - ahead_m
            if name == "wall" and left_m < 0.0 and 2.0 * left_m - ahead_m < -2.0 * PRESSED_M:
                near.append(way)
        return 0.5 * sum(max(0.0, -0.5 * along(way, towards)) for way in near)

    def limits(self) -> list[tuple[str, Direction, float, float]]:
        """Give name, direction, room that is left and braking of all that may not be run into."""
        agent, telemetry = self.agent, self.agent.telemetry
        x, y, z = telemetry.position_ned_m
        away_m, half = math.hypot(x, y), BRAKING_M_S2 / 2.0
        found = [
            ("floor", (0.0, 0.0, 1.0), -z - FLOOR_M, 0.5),
            ("ceiling", (0.0, 0.0, -1.0), CEILING_M + z, 0.5),
        ]
        if away_m > 0.5 * RADIUS_M:
            found.append(("fence", (x / away_m, y / away_m, 0.0), RADIUS_M - away_m, half))
        for peer in agent.neighbours:
            dx, dy, dz = peer.offset_ned_m
            if self.is_level:
                if abs(dz) >= SEPARATION_M:
                    continue
                dz = 0.0
            distance_m = math.hypot(dx, dy, dz)
            if distance_m > 1e-3:
                way = (dx / distance_m, dy / distance_m, dz / distance_m)
                room_m = distance_m - SEPARATION_M - peer.doubt_m
                found.append(("peer", way, room_m, half / 2.0))
        for index, range_m in enumerate(telemetry.ranges_m):
            if range_m == math.inf or self.now - telemetry.ranges_s[index] > 0.5:
                continue
            room_m = range_m - WALL_M
            if self.now - telemetry.ranges_s[index] > LATE_S:
                (n, e, d), yaw_rad = telemetry.ranges_from[index]
                if math.dist((x, y, z), (n, e, d)) <= FORGOTTEN_M:
                    room_m -= along((x - n, y - e, z - d), beam_of(index, yaw_rad))
            beam = beam_of(index, telemetry.yaw_rad)
            found.append(("wall", beam, room_m, half if index < 4 else 0.5))
        return found


def beam_of(index: int, yaw_rad: float) -> Direction:
    if index >= 4:
        return (0.0, 0.0, -1.0 if index == 4 else 1.0)
    bearing = yaw_rad + BEAM_BEARINGS_RAD[index]
    return (math.cos(bearing), math.sin(bearing), 0.0)


def along(velocity: Sequence[float], way: Direction) -> float:
    return sum(v * n for v, n in zip(velocity, way, strict=True))


@cache
def a_folder() -> Path:
    """Give a folder for mission files; one for all examples."""
    return Path(tempfile.mkdtemp())


def plan_of(wanted: tuple[float, float, float, float] | None, is_level: bool) -> OnePlan:
    if wanted is None:
        raise ValueError("no idea")
    north, east, down, heading = wanted
    velocity = [north, east] if is_level else [north, east, down]
    return OnePlan(velocity, heading, is_avoiding=False, target_m=velocity, is_new=False)


@settings(max_examples=200, deadline=None)
@given(st.booleans(), st.sampled_from([2, 3]), st.lists(steps, min_size=20, max_size=60))
def test_no_setpoint_breaks_a_limit_and_none_leaves_in_a_wrong_phase(
    is_px4: bool, dimensions: int, story: list[Step]
) -> None:
    bench = Bench(a_folder(), is_px4=is_px4, dimensions=dimensions)
    bench.take_off()
    for step in story:
        bench.suffer(step)


@settings(max_examples=60, deadline=None)
@given(st.booleans(), st.lists(steps, min_size=20, max_size=60))
def test_nothing_leaves_out_of_turn_before_take_off_either(is_px4: bool, story: list[Step]) -> None:
    bench = Bench(a_folder(), is_px4=is_px4, dimensions=2)
    for step in story:
        bench.suffer(step)


def test_the_bench_flies(tmp_path: Path) -> None:
    bench = Bench(tmp_path, is_px4=True, dimensions=2)
    bench.take_off()
    before = bench.setpoints
    no = (0.0, 0.0, 0.0)
    calm = Step(0, True, 4, no, None, no, 0.0, (500,) * 6, 90, None, (1.0, *no), None, b"")
    for _ in range(10):
        bench.suffer(calm)
    assert bench.setpoints == before + 10
