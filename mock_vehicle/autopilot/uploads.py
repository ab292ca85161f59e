"""The mission protocol from client to autopilot: count, items one by one, acknowledgement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mock_vehicle.autopilot.plans import ALL_KINDS, Item, Kind, Outcome, check, read_item, stored
from mock_vehicle.autopilot.progress import Progress
from mock_vehicle.autopilot.traits import Severity
from mock_vehicle.autopilot.transfers import Transfer, ack, ask, complain, end, is_ours
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

MISSION_WRITE_PARTIAL_LIST = wire.message("MISSION_WRITE_PARTIAL_LIST")

ITEM_COMPLAINT = "got MISSION_ITEM; GCS should send MISSION_ITEM_INT"
GUIDED = (2, 3)
"""MISSION_ITEM.current of a place to fly to now, and of an altitude."""
REJECTED_TEXT = "Flight plan update rejected"


def on_count(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Begin an upload, or refuse it."""
    v, client = frame.values, (frame.sysid, frame.compid)
    plans = autopilot.plans
    if not is_ours(autopilot, v):
        return
    refusal = _refused_count(autopilot, v, client)
    if refusal is not None:
        ack(autopilot, client, v.mission_type, refusal)
        if refusal == Outcome.NO_SPACE and plans.rules.no_space_text:
            text = plans.rules.no_space_text.format(plans.rules.capacity[v.mission_type])
            autopilot.say(Severity.WARNING, text, now)
    elif plans.transfer is not None and not plans.rules.restarts:
        ask(autopilot, plans.transfer, now)  # our first request was lost
    else:
        _begin_upload(autopilot, frame, 0, v.count - 1, now)


def _refused_count(autopilot: Autopilot, values: Any, client: tuple[int, int]) -> int | None:
    rules, transfer = autopilot.plans.rules, autopilot.plans.transfer
    if values.mission_type not in rules.capacity:
        return Outcome.UNSUPPORTED
    if transfer is not None and rules.restarts and transfer.partner != client:
        return Outcome.DENIED
    if transfer is not None and not rules.restarts:
        can_repeat = transfer.is_upload and transfer.next == 0 and transfer.partner == client
        return None if can_repeat else Outcome.ERROR
    if values.count > rules.capacity[values.mission_type]:
        return Outcome.NO_SPACE
    return None


def _begin_upload(
    autopilot: Autopilot, frame: wire.Frame, first: int, last: int, now: float
) -> None:
    kind, plans = frame.values.mission_type, autopilot.plans
    client, link = (frame.sysid, frame.compid), autopilot.to[0]
    plans.transfer = Transfer(kind, client, link, first, last, now, now)
    if first == 0 and not plans.rules.is_atomic:
        plans.replace(kind, plans.stored[kind][: last + 1])
    if first > last:
        _complete(autopilot, plans.transfer, now)
    else:
        ask(autopilot, plans.transfer, now)


def on_write_partial_list(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Begin to overwrite a part of a plan."""
    v, client = frame.values, (frame.sysid, frame.compid)
    plans = autopilot.plans
    if not is_ours(autopilot, v):
        return
    length = len(plans.stored.get(v.mission_type, ()))
    if plans.transfer is not None:
        ack(autopilot, client, v.mission_type, Outcome.DENIED)
    elif not 0 <= v.start_index <= v.end_index < length:
        autopilot.say(Severity.WARNING, REJECTED_TEXT, now)
        ack(autopilot, client, v.mission_type, Outcome.ERROR)
    else:
        _begin_upload(autopilot, frame, v.start_index, v.end_index, now)


def on_item(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Take an item of an upload with its place in whole numbers."""
    if is_ours(autopilot, frame.values):
        _note_form(autopilot, is_float=False)
        _take(autopilot, frame, read_item(frame.values, is_float=False), now)


def _is_guided(autopilot: Autopilot, frame: wire.Frame, item: Item, now: float) -> bool:
    """Fly to an item that belongs to no plan, and tell whether it is one."""
    v = frame.values
    if v.current not in GUIDED or v.mission_type != Kind.MISSION:
        return False
    result = autopilot.take_guided_item(item, v.current, now)
    if result is not None:
        ack(autopilot, (frame.sysid, frame.compid), v.mission_type, result)
    return result is not None


def on_float_item(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Take an outdated item with its place in degrees of 32 bits."""
    if is_ours(autopilot, frame.values):
        _note_form(autopilot, is_float=True)
        _take(autopilot, frame, read_item(frame.values, is_float=True), now)
        complain(autopilot, ITEM_COMPLAINT, now)


def _note_form(autopilot: Autopilot, *, is_float: bool) -> None:
    """Ask in the form that the client speaks, if the autopilot knows two."""
    if autopilot.plans.rules.has_sessions:
        autopilot.plans.speaks_floats = is_float


def _take(autopilot: Autopilot, frame: wire.Frame, item: Item, now: float) -> None:
    plans, v = autopilot.plans, frame.values
    transfer, client = plans.transfer, (frame.sysid, frame.compid)
    if _is_guided(autopilot, frame, item, now):
        return
    if transfer is None or not transfer.is_upload or transfer.partner != client:
        if plans.rules.unasked_item is not None:
            ack(autopilot, client, v.mission_type, plans.rules.unasked_item)
    elif v.seq == transfer.next and v.mission_type == transfer.kind:
        _store(autopilot, transfer, item, is_current=v.current == 1, now=now)
    elif plans.rules.wrong_sequence is not None:
        ack(autopilot, client, v.mission_type, plans.rules.wrong_sequence)
    else:
        transfer.heard_at = now  # and the right one is asked for when that is due


def _store(
    autopilot: Autopilot, transfer: Transfer, item: Item, *, is_current: bool, now: float
) -> None:
    plans = autopilot.plans
    result = check(plans.rules, transfer.kind, item)
    if result == Outcome.ACCEPTED:
        kept = stored(plans.rules, transfer.kind, item)
        if plans.rules.is_atomic:
            transfer.items.append(kept)
        else:
            result = plans.put(transfer.kind, transfer.next, kept)
    if result != Outcome.ACCEPTED:
        end(autopilot, result)
        return
    if is_current:
        transfer.current = transfer.next
    transfer.heard_at = now
    transfer.next += 1
    if transfer.next > transfer.last:
        _complete(autopilot, transfer, now)
    else:
        ask(autopilot, transfer, now)


def _complete(autopilot: Autopilot, transfer: Transfer, now: float) -> None:
    plans = autopilot.plans
    if plans.rules.is_atomic:
        plans.replace(transfer.kind, transfer.items)
        if transfer.kind == Kind.MISSION:
            autopilot.progress = Progress(current=transfer.current)
    end(autopilot, Outcome.ACCEPTED)
    if transfer.kind in plans.rules.received_texts:
        severity, text = plans.rules.received_texts[transfer.kind]
        autopilot.say(Severity(severity), text, now)


def on_clear_all(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:  # noqa: ARG001
    """Forget a plan, or all of them."""
    v, client = frame.values, (frame.sysid, frame.compid)
    if not is_ours(autopilot, v):
        return
    kinds = list(Kind) if v.mission_type == ALL_KINDS else [v.mission_type]
    if not set(kinds) <= set(Kind):
        ack(autopilot, client, v.mission_type, Outcome.UNSUPPORTED)
        return
    transfer = autopilot.plans.transfer
    if transfer is not None and not transfer.is_upload and transfer.kind in kinds:
        autopilot.plans.transfer = None  # there is nothing left to fetch
    for kind in kinds:
        autopilot.plans.replace(kind, [])
    if Kind.MISSION in kinds:
        autopilot.progress = Progress()
    ack(autopilot, client, v.mission_type, Outcome.ACCEPTED)
