"""A mission as the bus tells it: messages in, in any order and more than once; a picture out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

from swarm_ctl.bus.messages import Ack, Coverage, Event, Info, Order, State, Status, read
from swarm_ctl.console.picture import UNLOGGED, Cell, Grid, Line, Picture, Vehicle, Victim
from swarm_ctl.model import Vec3

SILENT_S = 2.0
"""Vehicles tell their state twice a second; one that was not heard for longer is silent."""
CURVE_S = 1.0
"""Between two points of what is seen over time."""
MOST_WAITING = 200
"""Messages of a vehicle that wait until it is known where its frame begins."""


class Given(NamedTuple):
    """An order that was given, and what has become of it."""

    order: Order
    sysid: int | None
    """None is everybody."""
    asked: set[int]
    obeyed: set[int]
    refused: set[int]


class Watch:
    """One mission, watched over the bus.

    Every vehicle says of which run a message is. What an earlier run has left on the broker is
    ignored, and a run that is newer than the one watched begins another picture.
    """

    def __init__(self, mission: str) -> None:
        self.mission = mission
        self.runs: dict[int, str] = {}
        """The run of each vehicle: when it began."""
        self.picture = Picture({"mode": "live", "mission": mission, "unit": "m²"}, Grid(0.0))
        self._info: Info | None = None
        self._heard_s: dict[int, float] = {}
        self._link_ages_s: dict[int, float] = {}
        self._origins: dict[int, Vec3] = {}
        self._waiting: dict[int, deque[Callable[[Vec3], None]]] = {}
        self._deltas: dict[int, int] = {}
        self._events: set[tuple[int, int]] = set()
        self._given: Given | None = None

    def hear(self, topic: str, payload: bytes, now: float) -> None:
        """Take a message at a time in seconds of the console's own; leave what cannot be read."""
        _, _, sysid, *leaf = topic.split("/")
        if leaf == ["ack"] and sysid.isdecimal():
            if (ack := Ack.load(payload)) is not None:
                self._acknowledge(ack, int(sysid))
            return
        match read(topic, payload):
            case None:
                pass
            case Info() as info:
                self._introduce(info)
            case told if self._is_current(told.sysid, told.run):
                self._tell(told, now, is_all=leaf[-1:] == ["all"])

    def look(self, now: float) -> Picture:
        """Give the picture, with how long each vehicle has been silent at a time."""
        for sysid, heard_s in self._heard_s.items():
            vehicle, since_s = self.picture.vehicle(sysid), now - heard_s
            age_s = self._link_ages_s.get(sysid)
            if age_s is not None and vehicle.status == "online":
                vehicle.silent_s = age_s + (since_s if since_s > SILENT_S else 0.0)
        return self.picture

    # -- whose message it is -------------------------------------------------------------------

    def _introduce(self, info: Info) -> None:
        if self._info is not None and info.run < self._info.run:
            return
        for sysid in info.vehicles:
            if self._is_current(sysid, info.run):
                self.picture.vehicle(sysid)
        self._info = info
        self.picture.head = {**self.picture.head, **_head(info)}

    def _is_current(self, sysid: int, run: str) -> bool:
        known = self.runs.get(sysid, run)
        if run > known:
            self._begin_again(known)
        if run >= known:
            self.runs[sysid] = run
        return run >= known

    def _begin_again(self, old: str) -> None:
        """Begin another picture, in which only vehicles of other runs than the old one are left."""
        gone = {sysid for sysid, run in self.runs.items() if run == old}
        before, self.picture = self.picture, Picture(self.picture.head, self.picture.grid)
        for sysid, vehicle in before.vehicles.items():
            if sysid not in gone:
                self.picture.vehicles[sysid] = vehicle
        for kept in (self.runs, self._heard_s, self._link_ages_s, self._origins, self._waiting):
            for sysid in gone & kept.keys():
                del kept[sysid]
        self._deltas.clear()  # the ground of those that are left is told again as a whole
        self._events = {(sysid, number) for sysid, number in self._events if sysid not in gone}

    # -- what it tells -------------------------------------------------------------------------

    def _tell(self, told: State | Status | Event | Coverage, now: float, *, is_all: bool) -> None:
        match told:
            case State():
                self._heard_s[told.sysid] = now
                self._take_state(told, self.picture.vehicle(told.sysid))
            case Status():
                self.picture.vehicle(told.sysid).status = told.status
            case Event():
                self._take_event(told)
            case Coverage():
                take = partial(self._take_coverage, told, is_all=is_all)
                self._when_placed(told.sysid, take)

    def _take_state(self, state: State, vehicle: Vehicle) -> None:
        vehicle.phase, vehicle.is_waiting = state.phase, state.is_waiting
        vehicle.battery_fraction = state.battery
        vehicle.peers = tuple(state.neighbours)
        if state.link_age_s is not None:
            self._link_ages_s[state.sysid] = vehicle.silent_s = max(0.0, state.link_age_s)
        if (origin := _vec3(state.origin_ned_m)) is not None:
            self._origins[state.sysid] = origin
            for take in self._waiting.pop(state.sysid, ()):
                take(origin)
            if (place := _sum(origin, state.position_ned_m)) is not None:
                vehicle.move(place, state.yaw_rad)
        self.picture.time_s = max(self.picture.time_s, state.time_s)
        self._grow_curve()

    def _take_event(self, event: Event) -> None:
        if (event.sysid, event.id) in self._events:
            return
        self._events.add((event.sysid, event.id))
        if event.name in {"VictimFound", "VictimHeard"}:
            self._take_victim(event)
        if event.name not in UNLOGGED:
            self.picture.vehicle(event.sysid).note = event.words
            self.picture.tell(Line(event.time_s, event.sysid, event.name, event.words))

    def _take_victim(self, event: Event) -> None:
        number, finder = event.data.get("victim"), event.data.get("finder", event.sysid)
        if not isinstance(number, int) or not isinstance(finder, int):
            return
        victim = Victim(number, None, finder, event.time_s)
        self.picture.find(victim)

        def take(origin: Vec3) -> None:
            place = _sum(origin, event.data.get("position_ned_m"))
            self.picture.find(victim._replace(place_ned_m=place))

        self._when_placed(event.sysid, take)

    def _when_placed(self, sysid: int, take: Callable[[Vec3], None]) -> None:
        """Take something as soon as it is known where a vehicle's frame begins."""
        origin = self._origins.get(sysid)
        if origin is None:
            self._waiting.setdefault(sysid, deque(maxlen=MOST_WAITING)).append(take)
        else:
            take(origin)

    def _take_coverage(self, told: Coverage, origin: Vec3, *, is_all: bool) -> None:
        known = self._deltas.get(told.sysid, 0)
        if told.number <= known or told.cell_m <= 0.0:
            return
        if not self.picture.grid.cell_m:
            self.picture.grid = Grid(told.cell_m)
            self.picture.head = {**self.picture.head}
        self.picture.see(_cells(told, origin, self.picture.grid.cell_m))
        if is_all or told.number == known + 1:  # behind a gap, all so far is waited for
            self._deltas[told.sysid] = told.number

    # -- orders ----------------------------------------------------------------------------------

    def give(self, order: Order, sysid: int | None) -> None:
        """Take note of an order to one vehicle, or to all, and await its acknowledgements."""
        asked = set(self.picture.vehicles) if sysid is None else {sysid}
        self._given = Given(order, sysid, asked, set(), set())

    @property
    def answer(self) -> dict[str, Any] | None:
        """Tell what became of the last order: who obeys, who refuses, who has not answered."""
        if self._given is None:
            return None
        order, sysid, asked, obeyed, refused = self._given
        silent = asked - obeyed - refused
        return {
            "order": order.operator,
            "sysid": sysid,
            "obeyed": len(obeyed),
            "refused": sorted(refused),
            "silent": sorted(silent),
        }

    def _acknowledge(self, ack: Ack, sysid: int) -> None:
        if self._given is not None and ack.id == self._given.order.id:
            (self._given.obeyed if ack.accepted else self._given.refused).add(sysid)

    def _grow_curve(self) -> None:
        picture = self.picture
        last_s = picture.curve[-1][0] if picture.curve else -math.inf
        if picture.seen and picture.time_s >= last_s + CURVE_S:
            seen_m2 = picture.seen * picture.grid.cell_m**2
            picture.curve.append((round(picture.time_s, 1), round(seen_m2, 1)))


def _head(info: Info) -> Mapping[str, Any]:
    return {
        "planner": info.planner,
        "seed": info.seed,
        "run": info.run,
        "world": info.plan,
    }


def _cells(told: Coverage, origin: Vec3, cell_m: float) -> Iterator[Cell]:
    """Give the squares of the picture for those of a vehicle, moved by less than half an edge."""
    south, west = (math.floor(edge_m / cell_m + 0.5) for edge_m in origin[:2])
    scale = told.cell_m / cell_m
    for north, east, count in told.rows:
        i = south + math.floor((north + 0.5) * scale)
        for j in range(east, east + count):
            yield i, west + math.floor((j + 0.5) * scale)


def _sum(origin: Vec3, offset: Any) -> Vec3 | None:
    place = _vec3(offset)
    return place and Vec3(origin.x + place.x, origin.y + place.y, origin.z + place.z)


def _vec3(values: Any) -> Vec3 | None:
    """Take three finite numbers; anything else is no place."""
    if not isinstance(values, list) or len(values) != 3:
        return None
    if not all(isinstance(one, int | float) and math.isfinite(one) for one in values):
        return None
    return Vec3(*map(float, values))
