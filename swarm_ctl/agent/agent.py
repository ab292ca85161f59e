"""One vehicle's controller without sockets or clocks: bytes and `now` in, bytes and facts out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from swarm_ctl import wire
from swarm_ctl.agent.blind import LATE_S, NO_WALLS, sight
from swarm_ctl.agent.duties import DUTIES, IS_HOME
from swarm_ctl.agent.frame import FrameParams, SharedFrame
from swarm_ctl.agent.geofence import Guard, Motion
from swarm_ctl.agent.homing import Homeward, Trail
from swarm_ctl.agent.orders import COMMAND_IDS, COMMANDS, Inbox, obey
from swarm_ctl.agent.params import FlightParams, Limits, RangingParams
from swarm_ctl.agent.peer import MOST_DOUBT_M, Neighbour
from swarm_ctl.agent.peers import PeerTable
from swarm_ctl.agent.phases import (
    ENDED,
    EXPLORES,
    SILENT,
    STEERING,
    STREAMING,
    Cause,
    Phase,
    advance,
)
from swarm_ctl.agent.regain import HAS_LANDED, STILL_LANDING
from swarm_ctl.agent.sender import Sender
from swarm_ctl.agent.sharing import SCAN_M, Sharing
from swarm_ctl.agent.talk import Talk
from swarm_ctl.agent.victims import Victims
from swarm_ctl.agent.watch import TIME_OVER, Vigil, missing, watch
from swarm_ctl.autopilot import command as commands
from swarm_ctl.autopilot.command import Answer, Command, CommandQueue, command
from swarm_ctl.autopilot.telemetry import SCAN_HZ, SUBSCRIBED, Telemetry
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.one import ask_one, make_planner
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.model import ZERO, Event, Operator, Setpoint, Snapshot, Vec3

ROUND_TRIP_S = 0.1
"""What a link takes there and back that is not slow: `flight.response_s` has room for it."""
REPEAT_S = 2.0
"""Between two requests for the same change, when the first one was accepted without effect."""
_TUNNEL_ID, _ORIGIN_ID = wire.message("TUNNEL").id, wire.message("GPS_GLOBAL_ORIGIN").id

_AS_PLANNED = frozenset({TIME_OVER, IS_HOME, HAS_LANDED, STILL_LANDING})
_ENDING = frozenset(
    {Cause.FAULT, Cause.LAND, Cause.RETURN, Cause.PILOT, Cause.DISARMED, Cause.CANCELLED}
)


@dataclass(frozen=True, slots=True)
class Orders:
    """What every vehicle of a mission is told before take-off."""

    mission: str
    duration_s: float
    """Exploration time of each vehicle."""
    planner: PlannerParams
    flight: FlightParams
    limits: Limits
    seed: int
    frame: FrameParams = field(default_factory=FrameParams)
    ranging: RangingParams = field(default_factory=RangingParams)
    group: int = 1
    """Which of the mission's MAVLink networks this is: sysids repeat, random draws do not."""

    def seed_of(self, sysid: int, restarts: int) -> tuple[int, ...]:
        """Give the seed of a vehicle's random draws, another one after every restart."""
        if self.group > 1:
            return self.seed, sysid, restarts, self.group
        return (self.seed, sysid, restarts) if restarts else (self.seed, sysid)


class Agent:
    """Fly one vehicle through a mission.

    The shell calls `receive` with every datagram and `tick` ten times a second, and sends what
    `tick` gives. `watch.py` decides when a phase must end, `duties.py` what is done in it; both
    read and write the plain attributes below.
    """

    def __init__(
        self,
        sysid: int,
        orders: Orders,
        *,
        start_delay_s: float = 0.0,
        restarts: int = 0,
        birth: int = 0,
    ) -> None:
        """Begin with the first controller of a flight, or with one after some `restarts`.

        `birth` tells its log from what peers remember of an earlier run.
        """
        self.sysid = sysid
        self.orders = orders
        self.start_delay_s = start_delay_s
        self.now = self.began_s = 0.0
        """The mission begins with the run, or when `start` was ordered."""
        self.phase = Phase.CONNECTING
        self.entered_s = 0.0
        self.reason = self.trouble = ""
        """Why the present phase was entered, and what ended the mission early, in words."""
        self.refusal = ""
        """The last command the autopilot refused, and why."""
        self.parser = wire.Parser({*SUBSCRIBED, *COMMANDS})
        self.lost_before = 0
        """Frames that were lost before the last restart."""
        self.frame = SharedFrame(orders.frame, sysid)
        self.telemetry = Telemetry(sysid, self.frame.yaw_offset_rad)
        self.peers = PeerTable(orders.ranging, orders.flight, sysid=sysid)
        self.neighbours: list[Neighbour] = []
        """The fresh peers of this tick."""
        self.sender = Sender(sysid, self.frame.yaw_offset_rad)
        self.commands = CommandQueue()
        self.inbox = Inbox(sysid)
        self.trail = Trail()
        self.homeward = Homeward()
        self.victims = Victims(sysid)
        self.explored_from_s: float | None = None
        self.explored_to_s: float | None = None
        self.is_paused = self.is_given = self.is_steering = self.awaits_start = False
        """Held by the operator; given back by him; the last tick gave a setpoint; on the ground
        until `start` is ordered."""
        self.vigil = Vigil()
        self.homebound = ""
        """Why the vehicle is on its way home for good, in words; empty while it is not."""
        self.hold_ned_m = ZERO
        self.plan_s = -math.inf
        self.has_plan_failed = False
        self.planned_ned_m_s = ZERO
        self.target_ned_m: Vec3 | None = None
        self.yaw_rad = 0.0
        self._guard = Guard(orders.limits, orders.flight, is_level=orders.planner.dimensions == 2)
        planner = make_planner(
            orders.planner,
            speed_m_s=orders.flight.speed_m_s,
            climb_m_s=orders.flight.climb_m_s,
            seeds=[orders.seed_of(sysid, restarts)],
            sysid=sysid,
            birth=birth,
        )
        self._ask = ask_one(planner, orders.planner.dimensions)
        self._sharing = None
        if isinstance(planner, Explorer):
            self._sharing = Sharing(planner, orders.planner.dimensions)
            self.telemetry.streams.want(SCAN_HZ)
        self._scanned_s = -math.inf
        self.talk = Talk(self, self._sharing)
        self._events: list[Event] = []
        self._next_ask_s = 0.0

    # -- what the shell calls ------------------------------------------------------------------

    def sign_with(self, key: bytes, timestamp: int) -> None:
        """Sign what is sent and hear only who signs; `timestamp` is that of `now` 0."""
        self.sender.gate.take_key(key, timestamp)

    @property
    def is_ended(self) -> bool:
        """Whether the mission is over for this vehicle, one way or the other."""
        return self.phase in ENDED

    @property
    def explorer(self) -> Explorer | None:
        """The planner, if it is one with a memory."""
        return self._sharing.explorer if self._sharing is not None else None

    @property
    def messages_lost(self) -> int:
        """Frames of this vehicle that never came."""
        return self.lost_before + self.parser.lost_of(self.sysid)

    def receive(self, data: bytes, now: float) -> None:
        """Take a datagram from the vehicle's link; never raises on what is in it."""
        own, take, gate = self.sysid, self.telemetry.receive, self.sender.gate
        is_guarded = not gate.is_open
        for frame in self.parser.feed(data):
            if is_guarded and gate.refusal(frame):
                continue
            if frame.sysid == own:
                take(frame, now)
            elif frame.id == _TUNNEL_ID:
                self.talk.hear(frame, now)
            elif frame.id in COMMAND_IDS:
                self.inbox.receive(frame)

    def overhear(self, data: bytes, now: float) -> None:
        """Take what peers tell beside the vehicle's own link; nothing else is taken from there."""
        for frame in wire.Parser((_TUNNEL_ID,)).feed(data):
            if frame.sysid != self.sysid and not self.sender.gate.refusal(frame):
                self.talk.hear(frame, now, is_near=False)

    def tick(self, now: float) -> bytes:
        """Decide; give the frames to send, as one datagram (empty when there is nothing)."""
        self.now = now
        self.sender.gate.advance(now)
        if self.is_ended:
            self.telemetry.forget_news()  # which goes on as long as the vehicle does
            return b""
        self._digest()
        acks = self._obeyed(now) if self.inbox.has_any else []
        if not self.is_ended:  # by an order
            watch(self)
        velocity = None if self.is_ended else DUTIES[self.phase](self)
        self.is_steering = velocity is not None and self.phase in STREAMING
        frames = [] if self.is_ended else self._frames(velocity)
        return b"".join(frames + acks)

    def standstill(self) -> bytes:
        """Give a setpoint to stop by, for who finds this controller dead; empty if none is due."""
        if not self.is_steering or self.is_ended:
            return b""
        stand_in = Sender(self.sysid, self.frame.yaw_offset_rad)
        return stand_in.setpoint(Setpoint(ZERO, self.yaw_rad), self.now)

    def order(self, operator: Operator, now: float) -> bool:
        """Take an operator's order; False for one that makes no sense now, and changes nothing."""
        self.now = now
        self.inbox.forget()
        return obey(self, operator)

    def fail(self, reason: str, now: float) -> None:
        """Give up on this vehicle, because its shell broke or was told to."""
        self.now = now
        if not self.is_ended:
            self.enter(Cause.FAULT, reason)

    def drain_events(self) -> list[Event]:
        """Give the facts since the last call."""
        events, self._events = self._events, []
        return events

    def snapshot(self) -> Snapshot:
        """Show this vehicle as an operator's table does."""
        return Snapshot(
            sysid=self.sysid,
            phase=self.phase.value,
            position_ned_m=self.telemetry.position_ned_m,
            battery_fraction=self.telemetry.battery_fraction,
            peers=self.peers.heard(self.now),
            cluster=self.peers.cluster(self.now),
            victims=len(self.victims.seen),
            note=self.reason,
            silent_s=self.now - self.telemetry.heard_s,
        )

    # -- what watch and duties call ------------------------------------------------------------

    @property
    def in_phase_s(self) -> float:
        """Time since the present phase began."""
        return self.now - self.entered_s

    @property
    def is_time_to_ask(self) -> bool:
        """Whether the last request has had time to show an effect."""
        return self.now >= self._next_ask_s

    def ask(self, wanted: Command, again_s: float = REPEAT_S) -> None:
        """Request a command, and leave it time to show an effect."""
        self._next_ask_s = self.now + again_s
        self.commands.request(wanted)

    def why_not(self) -> str:
        """Say why the vehicle does not do as asked: in its own words, if it has any."""
        own = self.telemetry.why_not(self.now)
        return own or self.refusal or missing(self) or "no reason given"

    def note(self, name: str, **data: Any) -> None:
        """Record a fact."""
        self._events.append(Event(round(self.now, 3), self.sysid, name, data))

    def enter(self, cause: Cause, reason: str) -> None:
        """Change the phase as the table says, and record it."""
        before, self.phase = self.phase, advance(self.phase, cause)
        if cause in {Cause.OBSTACLE, Cause.CLEAR}:
            return  # avoiding is a part of exploring: too frequent for a line in the record
        self.reason = reason
        self.is_paused = self.is_paused and self.phase in {Phase.HOLDING, Phase.LOST}
        self.commands.clear()
        if cause is Cause.RETURN:
            self.homebound = reason
        if cause is Cause.SILENT:
            self.vigil.lost_from = before
        if cause in _ENDING and reason not in _AS_PLANNED:
            self.trouble = self.trouble or reason
        if before in EXPLORES:
            self.explored_to_s = self.now
        self.entered_s = self._next_ask_s = self.now
        self.hold_ned_m = self.telemetry.position_ned_m
        self.homeward.restart()
        self.vigil.mode_before = -1 if self.telemetry.is_failsafe else self.telemetry.custom_mode
        if self.phase not in STEERING:
            self.vigil.troubled_s = self.vigil.outside_s = None
            self.vigil.highest_m = -math.inf
        if self.phase is Phase.EXPLORING:
            self._begin_exploring()
        self.note("PhaseChanged", before=before.value, after=self.phase.value, reason=reason)

    def plan(self) -> None:
        """Ask the planner; a plan that fails leaves the old one to go stale, which holds."""
        place, dimensions = self.telemetry.position_ned_m, self.orders.planner.dimensions
        offsets = [peer.offset_ned_m for peer in self.neighbours]
        heard = zip(self.peers.heard(self.now), offsets, strict=True)
        ours = [offset[:dimensions] for sysid, offset in heard if not self.peers.is_strange(sysid)]
        if self._sharing is not None:
            self._look_around(self._sharing, offsets)
        try:
            plan = self._ask(
                list(place[:dimensions]), self.telemetry.yaw_rad, self.telemetry.ranges_m, ours
            )
            velocity, yaw_rad = _vec3(plan.velocity_m_s, 0.0), plan.heading_rad
            if not all(map(math.isfinite, (*velocity, yaw_rad))):
                raise ValueError(f"a plan that is no number: {velocity}, {yaw_rad}")  # noqa: TRY301
        except Exception as error:  # noqa: BLE001 - whatever breaks in a planner, hold
            if not self.has_plan_failed:
                self.note("PlannerFailed", error=f"{type(error).__name__}: {error}")
            self.has_plan_failed = True
            return
        self.plan_s, self.has_plan_failed = self.now, False
        self.planned_ned_m_s, self.yaw_rad = velocity, yaw_rad
        if plan.is_new:
            self.target_ned_m = _vec3(plan.target_m, place.z)
        match self.phase, plan.is_avoiding:
            case Phase.EXPLORING, True:
                self.enter(Cause.OBSTACLE, "")
            case Phase.AVOIDING, False:
                self.enter(Cause.CLEAR, "")

    def way_home(self, own: bool) -> list[Vec3]:
        """Give places to fly by, the start last: over known ground, else over its own trail."""
        place, d = self.telemetry.position_ned_m, self.orders.planner.dimensions
        flown = self.trail.way_home()
        if d == 2:  # a failsafe may have been lower, where this mission does not fly
            flown = [spot._replace(z=place.z) for spot in flown]
        if self._sharing is None or own or not flown:
            return flown
        known = self._sharing.explorer.way_to(place[:d], flown[-1][:d])
        return [_vec3(corner, place.z) for corner in known] or flown

    def _obeyed(self, now: float) -> list[bytes]:
        """Do what ground stations have ordered since the last tick; give the acknowledgements."""
        answers = self.inbox.answer(partial(obey, self), now)
        return [self.sender.acknowledge(ack) for ack in answers]

    # -- taking in -----------------------------------------------------------------------------

    def _digest(self) -> None:
        """Turn what was heard since the last tick into state and facts."""
        telemetry = self.telemetry
        if telemetry.peer_fixes:
            place, velocity = telemetry.position_ned_m, telemetry.velocity_ned_m_s
            self.peers.fix(telemetry.peer_fixes, place, velocity, self.now)
            telemetry.peer_fixes.clear()
        if telemetry.victim_fixes or self.victims.news:
            self._report_victims()
        if telemetry.texts or telemetry.acks:
            self._take_word()
        self.neighbours = self.peers.near(telemetry.position_ned_m, self.now)
        gained, lost = self.peers.contacts(self.now)
        if gained or lost:
            self.note("ContactsChanged", gained=gained, lost=lost)
        for sysid, apart_m in self.peers.doubts(telemetry.position_ned_m, self.now):
            self.note("PeerElsewhere", peer=sysid, apart_m=round(apart_m, 2))
        if self.phase in STEERING:
            self.trail.mark(telemetry.position_ned_m)
            if self._sharing is not None:
                self._sharing.meet(self.peers, self.now)

    def _take_word(self) -> None:
        """Note what the autopilot said, and take its answers."""
        telemetry = self.telemetry
        for text in telemetry.texts:
            self.note("StatusText", text=text.words, severity=text.severity)
        telemetry.texts.clear()
        for ack in telemetry.acks:
            self._answered(self.commands.acknowledge(ack, self.now))
        telemetry.acks.clear()

    def _report_victims(self) -> None:
        """Tell of each victim once: seen before anybody told, or told."""
        for told_by, (number, finder, place) in self.victims.news:
            where = {"told_by": told_by, "position_ned_m": _rounded(place)}
            self.note("VictimHeard", victim=number, finder=finder, **where)
        self.victims.news.clear()
        for number, place in self.telemetry.victim_fixes:
            if self.victims.see(number, place):
                self.note("VictimFound", victim=number, position_ned_m=_rounded(place))
        self.telemetry.victim_fixes.clear()

    def _look_around(self, sharing: Sharing, peers_m: Sequence[Vec3]) -> None:
        """Show the explorer what the scanner saw since the last plan."""
        telemetry = self.telemetry
        if telemetry.scan is not None and telemetry.scan_s > self._scanned_s:
            self._scanned_s = telemetry.scan_s
            if hits := telemetry.scan.hits(SCAN_M):
                sharing.see(hits, telemetry.position_ned_m, peers_m)

    def _answered(self, answer: Answer | None) -> None:
        if answer is None or answer.is_accepted:
            return
        if answer.command.id == commands.SET_MESSAGE_INTERVAL and answer.result is not None:
            self.telemetry.streams.refused(answer.command, self.now)
        if answer.command.id in commands.ASIDE:
            return
        if answer.is_in_progress:
            self.note("CommandProgress", command=answer.command.id, percent=answer.progress)
            return
        self.refusal = answer.words
        self.note("CommandRefused", command=answer.command.id, reason=answer.reason)
        if answer.command.id == commands.COMPONENT_ARM_DISARM:
            self.commands.request(command(commands.RUN_PREARM_CHECKS))  # and hear why

    # -- changing ------------------------------------------------------------------------------

    def _begin_exploring(self) -> None:
        self.planned_ned_m_s = ZERO
        self.yaw_rad = self.telemetry.yaw_rad
        if self.explored_from_s is None:
            self.explored_from_s = self.now

    # -- sending -------------------------------------------------------------------------------

    def _frames(self, velocity: Vec3 | None) -> list[bytes]:
        now, sender, telemetry, frames = self.now, self.sender, self.telemetry, []
        is_silent, is_new = self.phase in SILENT, self.phase is Phase.CONNECTING
        if telemetry.autopilot is not None and not is_silent:
            for wanted in telemetry.streams.due(now, starts=is_new):
                self.commands.request(wanted)
        if self.phase in STREAMING and (stamp := telemetry.timesync.request(now)) is not None:
            frames.append(sender.timesync(stamp))
        due, timed_out = self.commands.poll(now)
        self._answered(timed_out)
        if due is not None and not is_silent:
            frames.append(sender.command(*due))
        if velocity is not None and self.is_steering:
            frames.append(sender.setpoint(self._last_word(velocity), now))
        if is_new and self.frame.is_time_to_ask(self.telemetry, now):
            self.commands.request(command(commands.REQUEST_MESSAGE, _ORIGIN_ID))
            origin = self.frame.origin_to_tell
            frames += [] if origin is None else [sender.origin(origin)]
        return frames + self.talk.tell(now)

    def _last_word(self, velocity: Vec3) -> Setpoint:
        """Let the guard bend what the duty wants; nothing else makes a setpoint.

        Who hears somebody in reach who has not been measured yet goes back where it came from: the
        two may fly at each other, and have half a second left.
        """
        telemetry = self.telemetry
        place, velocity_now = telemetry.position_ned_m, telemetry.velocity_ned_m_s
        if self.peers.is_anybody_about(self.now):
            velocity = Vec3(-velocity_now.x, -velocity_now.y, -velocity_now.z)
        late_s = max(0.0, telemetry.timesync.slowest_s(self.now) - ROUND_TRIP_S)
        motion = Motion(place, velocity_now, telemetry.yaw_rad, late_s)
        ranges, walls = telemetry.ranges_m, NO_WALLS
        if min(telemetry.ranges_s) < self.now - LATE_S:
            stale_s = self.orders.limits.range_stale_s
            ranges, walls = sight(telemetry, self.now, stale_s)
        knows_place = self.now - telemetry.position_s <= self.orders.limits.link_hold_s
        within_m = self.orders.limits.separation_m + MOST_DOUBT_M
        peers = self.neighbours + self.peers.zones(place, within_m, self.now)
        safe = self._guard.confine(velocity, motion, ranges, peers, walls, knows_place=knows_place)
        return Setpoint(safe, self.yaw_rad)


def _rounded(place: Vec3) -> list[float]:
    return [round(value, 2) for value in place]


def _vec3(values: list[float], z: float) -> Vec3:
    return Vec3(values[0], values[1], values[2] if len(values) > 2 else z)
