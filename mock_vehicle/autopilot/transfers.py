"""The plans that an autopilot keeps, and the transfer of one of them, up or down."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mock_vehicle.autopilot.link import Link
from mock_vehicle.autopilot.plans import Item, Kind, Outcome, PlanRules
from mock_vehicle.autopilot.traits import Severity
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

MISSION_ACK = wire.message("MISSION_ACK")
FENCE_OVERHEAD = 2.0
"""FENCE_TOTAL was 6 for a polygon of four corners."""
MISSION_REQUEST = wire.message("MISSION_REQUEST")


@dataclass
class Transfer:
    """An upload or a download that goes on."""

    kind: int
    partner: tuple[int, int]
    """sysid and compid of the client."""
    link: Link
    next: int
    """The item that is asked for, or was asked for last."""
    last: int
    heard_at: float
    asked_at: float
    is_upload: bool = True
    items: list[Item] = field(default_factory=list)
    """What an atomic upload has brought so far."""
    current: int = 0
    """The item that the client marked as the one to begin with."""


class Plans:
    """The three plans that an autopilot keeps, and the transfer of one; they survive reboots."""

    def __init__(self, rules: PlanRules) -> None:
        self.rules = rules
        self.stored: dict[int, list[Item]] = {kind: [] for kind in Kind}
        self.versions: dict[int, int] = dict.fromkeys(Kind, 0)
        """How often each plan has changed."""
        self.untold: set[int] = set()
        """Plans whose new length no parameter tells yet."""
        self.transfer: Transfer | None = None
        self.speaks_floats = False
        """The last client that fetched used the outdated messages."""
        self.complaints: set[str] = set()
        """Said already; once is enough."""

    @property
    def mission(self) -> list[Item]:
        """The items of the mission; item 0 may be home."""
        return self.stored[Kind.MISSION]

    @property
    def has_mission(self) -> bool:
        """Whether there is anything to fly."""
        return len(self.mission) > self.rules.has_home

    def put(self, kind: int, sequence: int, item: Item) -> int:
        """Store an item over another, or behind the last one."""
        items = self.stored[kind]
        if sequence > len(items):
            return Outcome.ERROR
        items[sequence : sequence + 1] = [item]
        self._note_change(kind)
        return Outcome.ACCEPTED

    def replace(self, kind: int, items: list[Item]) -> None:
        """Store a whole plan."""
        self.stored[kind] = items
        self._note_change(kind)

    def _note_change(self, kind: int) -> None:
        self.versions[kind] += 1
        if kind in self.rules.totals:
            self.untold.add(kind)


def ack(autopilot: Autopilot, client: tuple[int, int], kind: int, result: int) -> None:
    """Send MISSION_ACK."""
    autopilot.send(MISSION_ACK, *client, result, kind)


def ask(autopilot: Autopilot, transfer: Transfer, now: float) -> None:
    """Ask the client for the next item."""
    transfer.asked_at = now
    rules = autopilot.plans.rules
    request = MISSION_REQUEST if autopilot.plans.speaks_floats else rules.request
    autopilot.send(request, *transfer.partner, transfer.next, transfer.kind)


def tell_totals(autopilot: Autopilot) -> None:
    """Tell the parameters that count the items; fences and rally points when they are complete."""
    plans = autopilot.plans
    for kind in sorted(plans.untold):
        if kind != Kind.MISSION and plans.transfer is not None:
            continue
        plans.untold.discard(kind)
        name, total = plans.rules.totals[kind], float(len(plans.stored[kind]))
        if kind == Kind.FENCE and total:
            total += FENCE_OVERHEAD
        if autopilot.parameters[name] != total:
            autopilot.set_parameter(name, total)
            if autopilot.is_talkative:
                autopilot.parameter_service.tell(autopilot, name)


def end(autopilot: Autopilot, result: int | None) -> None:
    """Close the transfer, and perhaps tell the result."""
    transfer, autopilot.plans.transfer = autopilot.plans.transfer, None
    if transfer is not None and result is not None:
        ack(autopilot, transfer.partner, transfer.kind, result)


def complain(autopilot: Autopilot, text: str, now: float) -> None:
    """Say once that a client speaks an outdated form."""
    plans = autopilot.plans
    if plans.rules.warns_of_floats and text not in plans.complaints:
        plans.complaints.add(text)
        autopilot.say(Severity.WARNING, text, now)


def is_ours(autopilot: Autopilot, values: Any) -> bool:
    """Whether a message of the protocol has us as its target."""
    return autopilot.accepts_command(values.target_system, values.target_component, 0)
