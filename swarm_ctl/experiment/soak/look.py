"""What the checks look at, tick by tick: the truth, the wire, and the controllers from inside."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mock_vehicle.dynamics import Control
from mock_vehicle.faults import Fault, parse_fault
from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.phases import STEERING, Phase
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.experiment.soak.scenario import Scenario
from swarm_ctl.model import Event
from swarm_ctl.record.unrecorded import Unrecorded

_IDS = {wire.message(name).id: name for name in ("SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG")}
MET_S = 2.0
"""Two radios that reached each other for so long know of each other (peers.FRESH_S, twice)."""
MOST_LOST = 0.5
"""Share of frames that a spoilt radio may lose and still count as one."""
HEALED_S = 3.0
"""From the end of a fault to full control: a heartbeat, a round trip, and what is flown meanwhile
(PX4 offboard loss 1 s, ArduPilot's GUID_TIMEOUT 3 s)."""
STILLED_S = 8.0
"""From the end of a gust: the integral that has leant against it takes so long to empty."""

OUT_OF_HAND: Mapping[str, float] = {
    "motor": math.inf,
    "wind-gust": STILLED_S,
    "reboot": math.inf,
    "freeze": HEALED_S,
    "frozen-telemetry": HEALED_S,
    "link-loss": HEALED_S,
    "link-delay": HEALED_S,
    "link-burst": HEALED_S,
    "link-freeze": HEALED_S,
}
"""Faults with which nobody can steer a vehicle, and for how long after they have healed."""
BLIND: Mapping[str, float] = {"rangefinder-stuck": HEALED_S, "rangefinder-noise": HEALED_S}
"""Faults with which a vehicle cannot tell where the walls are, though it believes to."""
RUNAWAY_M_S = 0.3
"""Whoever is out of hand and faster than this runs away; in a corner nobody can make room."""
BLOW_M = 0.65
"""Two bodies of 0.3 m radius, and what is flown between two looks."""
SHIFTED: Mapping[str, float] = {"gnss-glitch": HEALED_S}
"""Faults by which an ArduPilot that takes off flies aside: no setpoint may follow that command."""


class Witness(Unrecorded):
    """The record of a flight that is only watched: frames that leave, and facts."""

    def __init__(self, *, hashed: bool) -> None:
        super().__init__(hashed=hashed, events=self)
        self._sha256 = self.hash
        self.hash = self
        self.events: list[Event] = []
        """Since they were last taken."""
        self.agents: list[Agent] = []
        self.sent: dict[int, tuple[Phase, bytes]] = {}
        """The last datagram of each vehicle that sent one, by index, and its phase as it did."""

    def frame(self, index: int, outgoing: bool, data: bytes) -> None:
        """Keep what a controller sends."""
        self._sha256.frame(index, outgoing, data)
        if outgoing:
            self.sent[index] = (self.agents[index].phase, data)

    def hexdigest(self) -> str:
        """Give the hash, if one is kept."""
        return self._sha256.hexdigest()

    def write(self, event: Event) -> None:
        """Keep a fact."""
        self.events.append(event)


class Look:
    """One flight as it is now, and what of its past the checks need."""

    def __init__(self, scenario: Scenario, arena: Arena, witness: Witness) -> None:
        self.scenario, self.arena = scenario, arena
        self.mission = scenario.mission
        self.fleet = arena.fleet
        self.agents = [controller.agent for controller in arena.controllers]
        self.range = range(len(self.agents))
        self.now = 0.0
        self.places_ned_m: list[list[float]] = []
        """True positions."""
        self.airborne: list[bool] = []
        self.steered: list[bool] = []
        """Whether a vehicle is airborne in the hands of its controller, who is to blame then."""
        self.sent: dict[int, tuple[Phase, list[str]]] = {}
        """Who has sent setpoints and commands since the last tick, in which phase; their names."""
        self.events: list[Event] = []
        """Facts since the last tick."""
        self.gaps_m: list[tuple[int, int, float]] = []
        """Pairs of which one is steered and whose radios know each other, and how far apart."""
        self.closest_m = math.inf
        """The closest approach of a pair that may not touch."""
        self.taken_s: dict[int, float] = {}
        """Whose pilot has chosen another mode, and when."""
        self.given_s: dict[int, float] = {}
        """Whose pilot has given it back, however fast it flew or fell, and when."""
        self.wall_contacts = 0
        self.coverage = 0.0
        self.within: set[int] = set()
        """Who has been inside its fence since it was steered."""
        self.between: set[int] = set()
        """Who has been between floor and ceiling since it was steered."""
        self.reported: set[tuple[int, int]] = set()
        """Who has reported which victim."""
        self._witness = witness
        witness.agents = self.agents
        self._unlinked_s: dict[tuple[int, int], float] = {}
        faults = [parse_fault(text) for text in scenario.faults if "controller:" not in text]
        self._loose_s = [_spans(faults, index + 1, OUT_OF_HAND) for index in self.range]
        self._blind_s = [_spans(faults, index + 1, BLIND) for index in self.range]
        self._shifted_s = [_spans(faults, index + 1, SHIFTED) for index in self.range]
        self._rising_s: dict[int, float] = {}
        self._struck_s: dict[int, float] = {}
        """Who was run into by a runaway, and when."""

    def advance(self) -> None:
        """Take in what the last tick brought."""
        self.now = now = self.arena.now
        rising = (i for i in self.range if self.agents[i].phase is Phase.TAKEOFF)
        self._rising_s.update(dict.fromkeys(rising, now))
        body, vehicles = self.fleet.dynamics, self.fleet.vehicles
        self.places_ned_m = body.position_ned_m.tolist()
        self.airborne = [not grounded for grounded in body.on_ground.tolist()]
        self.steered = [
            self.airborne[i]
            and self.agents[i].phase in STEERING
            and vehicles[i].alive
            and self.is_ours(i)
            and not self.is_out_of_hand(i)
            and now - self.given_s.get(i, -math.inf) > HEALED_S
            for i in self.range
        ]
        sent, self._witness.sent = self._witness.sent, {}
        self.sent = {i: (phase, _names(data)) for i, (phase, data) in sent.items()}
        self.events, self._witness.events = self._witness.events, []
        self._note_links()
        self._note_blows()
        self.gaps_m = [
            (i, j, self._gap_m(i, j))
            for i in self.range
            for j in self.range[i + 1 :]
            if (self.steered[i] or self.steered[j])
            and self._know_each_other(i, j)
            and not (self._runs_away(i) or self._runs_away(j))
        ]
        self.closest_m = min([self.closest_m, *(gap_m for _, _, gap_m in self.gaps_m)])

    @property
    def falling(self) -> list[bool]:
        """Tell who is airborne with its motors off."""
        off = (self.fleet.dynamics.control == Control.OFF).tolist()
        return [airborne and is_off for airborne, is_off in zip(self.airborne, off, strict=True)]

    def is_out_of_hand(self, index: int) -> bool:
        """Whether a fault comes between a vehicle and its controller, or did just now."""
        return _within(self._loose_s[index], self.now)

    def is_ours(self, index: int) -> bool:
        """Whether the true mode of a vehicle is the one in which controllers steer."""
        return self.fleet.vehicles[index].mode_name in {"OFFBOARD", "GUIDED"}

    def is_blind(self, index: int) -> bool:
        """Whether nobody could keep a vehicle off walls.

        It does not see them, its autopilot flies to the side, or a runaway has just run into it.
        """
        return (
            _within(self._blind_s[index], self.now)
            or self.now - self._struck_s.get(index, -math.inf) < HEALED_S
            or (_within(self._shifted_s[index], self.now) and self._has_just_risen(index))
        )

    def _has_just_risen(self, index: int) -> bool:
        """Whether ArduPilot takes off, to which nobody says where, or did a moment ago."""
        by_itself = self.fleet.vehicles[index].personality == "ardupilot"
        return by_itself and self.now - self._rising_s.get(index, -math.inf) < HEALED_S

    def _runs_away(self, index: int) -> bool:
        if not self.is_out_of_hand(index):
            return False
        velocity = self.fleet.dynamics.velocity_ned_m_s[index].tolist()
        return math.hypot(*velocity) > RUNAWAY_M_S

    def _know_each_other(self, one: int, other: int) -> bool:
        """Whether the radios of a pair have reached each other long enough."""
        return self.now - self._unlinked_s.get((one, other), 0.0) > MET_S

    def _note_blows(self) -> None:
        for i in self.range:
            if self._runs_away(i):
                near = (j for j in self.range if j != i and self._gap_m(i, j) < BLOW_M)
                self._struck_s.update(dict.fromkeys(near, self.now))

    def _gap_m(self, one: int, other: int) -> float:
        return math.dist(self.places_ned_m[one], self.places_ned_m[other])

    def error_m(self, index: int) -> float:
        """Give how wrong a vehicle's own position is, level and vertical together."""
        start = self.fleet.starts_ned_m[index].tolist()
        told = self.agents[index].telemetry.position_ned_m
        place = self.places_ned_m[index]
        return math.dist(told, [p - s for p, s in zip(place, start, strict=True)])

    def has_left(self, kept: set[int], index: int, beyond_m: float, slack_m: float) -> bool:
        """Tell whether a steered vehicle of those that were inside is outside by its own doing."""
        if not self.steered[index]:
            kept.discard(index)
        elif beyond_m <= 0.0:
            kept.add(index)
        return index in kept and beyond_m > slack_m and beyond_m > slack_m + self.error_m(index)

    def _note_links(self) -> None:
        linked, lost = self.fleet.radio.linked.tolist(), self.fleet.radio.extra_loss.tolist()
        for i in self.range:
            for j in self.range[i + 1 :]:
                if not (linked[i][j] and linked[j][i]) or max(lost[i], lost[j]) > MOST_LOST:
                    self._unlinked_s[i, j] = self.now


def _spans(
    faults: list[Fault], sysid: int, kinds: Mapping[str, float]
) -> list[tuple[float, float]]:
    """Give from when to when a vehicle suffers from faults of these kinds, and from their wake."""
    return [
        (fault.time_s, fault.time_s + fault.lasts_s + kinds[fault.kind])
        for fault in faults
        if fault.kind in kinds and fault.vehicle in {None, sysid}
    ]


def _within(spans: list[tuple[float, float]], now: float) -> bool:
    return any(begins_s <= now <= ends_s for begins_s, ends_s in spans)


def _names(data: bytes) -> list[str]:
    ids = (int.from_bytes(frame[7:10], "little") for frame in wire.split(data))
    return [_IDS[number] for number in ids if number in _IDS]
