"""Everything stepped together: physics, contacts, sensors, radio, telemetry; bytes and `now` in."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.autopilot.parameters import share_out
from mock_vehicle.autopilot.traits import Rates
from mock_vehicle.contact import Touch
from mock_vehicle.dynamics import OFF, Dynamics
from mock_vehicle.errors import WorldError
from mock_vehicle.faults import Fault, check
from mock_vehicle.geodesy import Origin
from mock_vehicle.lossy import LossyLinks
from mock_vehicle.pairs import pairs
from mock_vehicle.radio import Radio
from mock_vehicle.referee import Files, Referee, write_files
from mock_vehicle.sensors.battery import Batteries
from mock_vehicle.sensors.gnss import Gnss, Reception
from mock_vehicle.sensors.infrared import Infrared
from mock_vehicle.sensors.odometry import Odometry
from mock_vehicle.sensors.rangefinder import BODY_RADIUS_M, RANGE_MIN_M, Rangefinders
from mock_vehicle.sensors.readings import Readings
from mock_vehicle.shards import Part, whole
from mock_vehicle.shards.abroad import NO_STRANGERS, Abroad, Strangers, tag_of
from mock_vehicle.trouble import Troubles
from mock_vehicle.vehicle import LIMITS, PERSONALITIES, Personality, Vehicle, packed, refresh_all
from mock_vehicle.wind import Wind

if TYPE_CHECKING:
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]

STEP_S = 0.02
TICK_S = 0.1
"""Time between two looks of sensors and referee."""
FULL_STEP_S = 0.01
"""Step at full rates: ATTITUDE of PX4 comes at 100 Hz."""
MEETING_M = 5.0
"""How far beyond sight vehicles of other shards may be and still be met before the next tick."""
WIND = 3
"""Place of the wind among `streams`."""


def streams(seed: int, shard: int = 1) -> list[np.random.Generator]:
    """Seed the chances of ranges, radio, odometry, wind and satellites.

    Shards draw each from its own part of the same streams, but for the wind, which is one; what
    streams spawn is the same in all, as the biases and the shadowing of the radio.
    """
    bits = [np.random.PCG64(each) for each in np.random.SeedSequence(seed).spawn(5)]
    for number, each in enumerate(bits):
        if number != WIND:
            each.advance(shard - 1 << 96)
    return [np.random.Generator(each) for each in bits]


def apart(a_m: FLOATS, b_m: FLOATS, loops: ModuleType | None = None) -> FLOATS:
    """Measure how far (n, 3) points are from (k, 3) points, (k, n), m; compiled loops may help."""
    distances = np.zeros((len(a_m), len(b_m)))
    if loops is not None:
        loops.apart(a_m, np.ascontiguousarray(b_m.T), distances)
        return distances
    for axis in (0, 2, 1):  # in this order: rounded otherwise, another flight would come of it
        gap = b_m[:, axis] - a_m[:, axis, None]
        gap *= gap
        distances += gap
    return np.sqrt(distances, out=distances)


class Fleet:
    """A fleet in its world, without sockets and clocks."""

    def __init__(
        self,
        world: World,
        personalities: Sequence[str],
        *,
        seed: int,
        first_sysid: int = 1,
        boot_s: float | None = 1.0,
        rates: Rates = "lean",
        faults: Sequence[Fault] = (),
        parameters: Mapping[str, float] | None = None,
        part: Part | None = None,
    ) -> None:
        """Put the vehicles on their starts.

        They are ready to arm `boot_s` s after the start, or as late as the real ones (None).
        `parameters` replace defaults; each vehicle takes those that its autopilot has, but for the
        sysid, which the fleet gives. `rates` "full" sends telemetry as often as the real ones, one
        frame per datagram; "shown" adds links for a ground station and a viewer to "lean". A
        `part` of a mission flies its own vehicles; `first_sysid` is that of its group.
        """
        self.world = world
        self.personalities = list(personalities)
        self.n = len(self.personalities)
        self.part = part or whole(self.n)
        members, own = self.part.members, self.part.own
        sysids = range(first_sysid, first_sysid + len(members))
        self._first = own.start - members.start
        self.sysids = list(sysids[self._first : self._first + self.n])
        self.abroad = None if part is None else Abroad(part, tag_of(world, part, seed), first_sysid)
        check(faults, self.sysids)
        ours = [f for f in world.spec.faults if f.vehicle in {None, *self.sysids}]
        rngs = streams(seed, self.part.shard)
        self.step_s = FULL_STEP_S if rates == "full" else STEP_S
        """Mission time of one `step`."""
        self._steps_per_sample = round(TICK_S / self.step_s)
        self._steps_per_tick = 1 if rates == "full" else self._steps_per_sample
        self._pack = list if rates == "full" else packed
        self.takes_turns = False
        """Whether the vehicles speak in turn, in the steps between two looks of the sensors, rather
        than all at once: neither who serves them nor their clients are busy for long then."""
        self._build(world, personalities, seed, boot_s, rates, parameters or {})
        self._equip(world, sysids, rngs)
        self.links = LossyLinks(seed + (self.part.shard - 1 << 64))
        """What lies between autopilots and their peers."""
        self._troubles = Troubles(self, [*ours, *faults])
        self._now = 0.0
        self._steps = 0
        if self.abroad is not None:
            self._cross(world, self.abroad)
        self._others = ~np.eye(self.n, dtype=bool)
        self._strangers = NO_STRANGERS
        self._sight_m = world.spec.sensors.range_max_m + MEETING_M
        self._touch = Touch(world, self.dynamics, self.referee)
        self._loops: ModuleType | None = None

    def _build(
        self,
        world: World,
        personalities: Sequence[str],
        seed: int,
        boot_s: float | None,
        rates: Rates,
        parameters: Mapping[str, float],
    ) -> None:
        own = share_out(parameters, [PERSONALITIES[kind].dialect for kind in personalities])
        part = self.part
        places = world.starts(part.vehicles, seed)
        self.starts_ned_m, yaw_rad = (rows[part.own.start : part.own.stop] for rows in places)
        limits = [LIMITS[personality] for personality in personalities]
        self.dynamics = Dynamics(self.n, self.starts_ned_m, yaw_rad, limits)
        self.readings = Readings.blank(self.n)
        gnss = world.spec.gnss
        self.readings.range_max_m = world.spec.sensors.range_max_m
        self.readings.range_min_m = RANGE_MIN_M
        self.readings.has_odometry = gnss.reception != "present"
        self.readings.gnss_reception[:] = Reception[gnss.reception.upper()]
        self.vehicles = [
            Vehicle(
                index,
                sysid,
                cast("Personality", personality),
                self.dynamics,
                self.readings,
                self.starts_ned_m[index],
                boot_s=boot_s,
                rates=rates,
                origin=Origin(gnss.latitude_deg, gnss.longitude_deg, gnss.amsl_m),
                uid=(seed ^ part.group - 1 << 55) << 8 | sysid,
                parameters=own[index],
            )
            for index, (sysid, personality) in enumerate(
                zip(self.sysids, personalities, strict=True)
            )
        ]

    def _equip(self, world: World, sysids: Sequence[int], rngs: list[np.random.Generator]) -> None:
        spec, sensors = world.spec, world.spec.sensors
        self.rangefinders = Rangefinders(
            range_max_m=sensors.range_max_m, noise_m=sensors.range_noise_m, rng=rngs[0]
        )
        self._infrared = Infrared(world)
        self.batteries = Batteries(self.n)
        own = slice(self._first, self._first + self.n)
        self.radio = Radio(sysids, spec.radio, rngs[1], world.walls_between, own)
        self.odometry = Odometry(self.starts_ned_m, sensors.odometry_drift_fraction, rngs[2])
        self.wind = Wind(spec.wind, self.n, rngs[3])
        self.gnss = Gnss(self.n, Reception[spec.gnss.reception.upper()], rngs[4])
        self.referee = Referee(world, self.vehicles, self.batteries, self.starts_ned_m)

    def _cross(self, world: World, abroad: Abroad) -> None:
        """Let other shards know of the vehicles before they move."""
        if world.spec.radio.channel is not None:
            reason = "slots of a frequency cannot be shared by shards, which are milliseconds apart"
            raise WorldError(world.path, "radio.channel", reason)
        body, everybody = self.dynamics, np.ones(self.n, dtype=bool)
        loss = self.radio.extra_loss[self.radio.own]
        abroad.note(body.position_ned_m, body.velocity_ned_m_s, everybody, body.on_ground, loss)

    def compile(self) -> None:
        """Compile the hot loops where numba is installed: worth it for more than one flight."""
        self.dynamics.compile()
        self.world.compile()
        self.radio.compile()
        if importlib.util.find_spec("numba") is not None:
            self._loops = importlib.import_module("mock_vehicle.world.loops")

    def sign_with(self, key: bytes, timestamp: int) -> None:
        """Give every vehicle the swarm's key; `timestamp` is that of mission time 0."""
        for vehicle in self.vehicles:
            vehicle.sign_with(key, timestamp)

    def write(self, folder: Path) -> None:
        """Write what the referee saw and the radio's figures; docs/run-folder.md tells of it."""
        write_files(folder, self.files())

    def files(self, *, so_far: bool = False, pace: Mapping[str, Any] | None = None) -> Files:
        """Give what is to be written, of the flight `so_far` or of all of it.

        `pace` says how well the fleet was served in real time.
        """
        files = self.referee.files(so_far=so_far)
        files["truth.json"] |= pace or {}
        if self.part.shards > 1:  # others add what theirs have seen
            files["truth.npz"] |= self.referee.coverage.volumes()
        return {**files, "radio.json": self.radio.figures.report()}

    @property
    def refused(self) -> int:
        """Frames that all vehicles refused, for want of a good signature."""
        return sum(vehicle.refused for vehicle in self.vehicles)

    @property
    def dropped(self) -> int:
        """Frames that full queues have dropped."""
        links = (link for vehicle in self.vehicles for link in vehicle.autopilot.links)
        return self.links.dropped + sum(link.dropped for link in links)

    @property
    def places(self) -> list[tuple[int, int]]:
        """Every link as (vehicle index, link): those to all companions first."""
        pairs = [(link, v.index) for v in self.vehicles for link in range(v.links)]
        return [(index, link) for link, index in sorted(pairs)]

    def receive(self, index: int, data: bytes, now: float, link: int = 0) -> None:
        """Take a datagram that was sent over a link to vehicle `index`."""
        self._now = now
        for arrived in self.links.carry(index, link, "uplink", [data], now):
            self._hear(index, arrived, now, link)

    def _hear(self, index: int, data: bytes, now: float, link: int) -> None:
        if self.vehicles[index].hears:
            for frame in self.vehicles[index].receive(data, now, link):
                self.radio.send(index, frame, now)
                if self.abroad is not None:
                    self.abroad.outgoing.append((self.part.own[index], frame))

    def learn(self, data: bytes, shard: int, vehicles: range, now: float) -> bool:
        """Take what another shard, which flies these vehicles, told; tell whether it made sense."""
        heard = None if self.abroad is None else self.abroad.learn(data, shard, vehicles)
        for vehicle, frame in heard or ():
            self.radio.overhear(vehicle - self.part.members.start, frame, now)
        return heard is not None

    def answers(self, index: int, link: int = 0) -> list[bytes]:
        """Take the datagrams that are ready to leave over a link, without waiting for a tick."""
        frames = self.vehicles[index].take(link)
        return self._pack(self.links.carry(index, link, "downlink", frames, self._now))

    def strike(self, fault: Fault, now: float) -> None:
        """Break something now, whatever time the fault says; ValueError if nobody is struck."""
        check([fault], self.sysids)
        self._troubles.strike(fault, now)

    def heal(self, now: float, *, vehicle: int | None = None, kind: str | None = None) -> None:
        """End what is broken for a while: of one vehicle (sysid) or all, of one kind or all."""
        self._troubles.heal(now, vehicle=vehicle, kind=kind)

    def step(self, now: float) -> list[tuple[int, bytes]]:
        """Advance by `step_s` to `now`; give the datagrams (index, bytes) for the companions.

        Those for ground stations wait for `answers`.
        """
        self._now = now
        self._troubles.turn(now)
        for place, data in self.links.late("uplink", now):
            self._hear(place.vehicle, data, now, place.link)
        for index, frame in self.radio.carry(now):
            if self.vehicles[index].hears:
                self.vehicles[index].deliver(frame)
        self.dynamics.step(self.step_s, self.wind.over(self.dynamics.on_ground))
        self._steps += 1
        if self._steps % 2 == 0:
            self._touch.walls()
        self._touch.one_another(self._strangers_now(now))
        sensed = self._steps % self._steps_per_sample == 0
        if sensed:
            self._sample(now)
        late = [(at.vehicle, data) for at, data in self.links.late("downlink", now, links=(0,))]
        turn, turns = self._steps % self._steps_per_tick, self._steps_per_tick - 1
        if self.takes_turns and turns and self._steps > turns:
            speakers = self.vehicles[turn - 1 :: turns] if turn else []
            return late + self._tick(speakers, now, sensed=True)
        return late if turn else late + self._tick(self.vehicles, now, sensed=sensed)

    def _sample(self, now: float) -> None:
        """Let all sensors measure and the referee look."""
        self._troubles.obey(now)
        position = self.dynamics.position_ned_m
        bodies, distances = self._look_around(position, now)
        alive = np.array([vehicle.alive for vehicle in self.vehicles])
        airborne = ~self.dynamics.on_ground & alive
        sightings = self._infrared.see(position, airborne)
        group = self._hear_around(distances, alive, now)
        self._read(bodies, distances, group, sightings, now)
        self._drain(alive)
        own, linked = self.radio.own, self.radio.linked
        among = distances[:, : self.n]
        self.referee.sample(now, position, airborne, among, sightings, linked[own, own])
        if self.abroad is not None:
            self.referee.separate(distances[airborne, self.n :][:, ~self._strangers.grounded])
        self.wind.blow(TICK_S)
        self._touch.find_near(distances, self._strangers)

    def _strangers_now(self, now: float) -> Strangers:
        return NO_STRANGERS if self.abroad is None else self.abroad.strangers(now)

    def _look_around(self, position: FLOATS, now: float) -> tuple[FLOATS, FLOATS]:
        """Give all bodies that may be near, the own first, and how far they are from the own."""
        bodies = position
        if self.abroad is not None:
            self._strangers = self.abroad.choose(position, self._sight_m, now)
            bodies = np.concatenate((position, self._strangers.position_ned_m))
        return bodies, apart(position, bodies, self._loops)

    def _hear_around(self, distances: FLOATS, alive: BOOLS, now: float) -> FLOATS:
        """Let the radio find who hears whom; give where all of the group are, (g, 3).

        Other shards are told where the own vehicles are.
        """
        body, radio = self.dynamics, self.radio
        position = body.position_ned_m
        if self.abroad is None:
            radio.update(distances, alive, position, now)
            return position
        on_air, loss = alive & radio.on_air, radio.extra_loss[radio.own]
        self.abroad.note(position, body.velocity_ned_m_s, on_air, body.on_ground, loss)
        everybody, on_air, radio.extra_loss[:] = self.abroad.group(position, alive, loss, now)
        radio.update(apart(everybody, everybody, self._loops), on_air, everybody, now)
        return everybody

    def _tick(
        self, speakers: Sequence[Vehicle], now: float, *, sensed: bool
    ) -> list[tuple[int, bytes]]:
        """Let autopilots steer and speak."""
        refresh_all(speakers, self.dynamics, self.readings, sensed=sensed)
        leaving: list[tuple[int, bytes]] = []
        for vehicle in speakers:
            if vehicle.hears:
                vehicle.tick(now)
                index = vehicle.index
                frames = self.links.carry(index, 0, "downlink", vehicle.take(), now)
                leaving += [(index, data) for data in self._pack(frames)]
        return leaving

    def _read(
        self,
        bodies: FLOATS,
        distances: FLOATS,
        group: FLOATS,
        sightings: tuple[INDICES, ...],
        now: float,
    ) -> None:
        """Write the readings of rangefinders, radio, infrared and odometry."""
        body, readings = self.dynamics, self.readings
        position, attitude = body.position_ned_m, (*body.lean_rad(), body.yaw_rad)
        close = distances < self.rangefinders.range_max_m + BODY_RADIUS_M
        close[:, : self.n] &= self._others
        near = pairs(close)
        ranges = self.rangefinders.measure(self.world, position, body.yaw_rad, near, bodies)
        readings.ranges_m[:], readings.ring_m[:] = ranges
        readings.scans_cm = None
        readings.peers[:] = self.radio.fixes(group, attitude, now)
        readings.victims[:] = self._infrared.fixes(sightings, position, attitude)
        readings.drift_ned_m[:] = self.odometry.move(position, TICK_S)
        readings.gnss_error_ned_m[:] = self.gnss.measure(TICK_S)
        readings.gnss_reception[:] = self.gnss.reception

    def _drain(self, alive: BOOLS) -> None:
        """Empty the batteries by one tick; who has nothing left falls silent and drops."""
        spinning = self.dynamics.control != OFF
        airborne = ~self.dynamics.on_ground
        self.batteries.step(
            TICK_S,
            self.dynamics.velocity_ned_m_s,
            airborne=airborne,
            powered=alive,
            spinning=spinning,
        )
        for index in np.nonzero(alive & (self.batteries.fraction <= 0.0))[0].tolist():
            self.vehicles[index].die()
        self.readings.battery_fraction[:] = self.batteries.fraction
        self.readings.battery_voltage_v[:] = self.batteries.voltage_v
        self.readings.battery_current_a[:] = self.batteries.current_a
