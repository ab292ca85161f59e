"""The mission protocol from autopilot to client: list, count, items as they are asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

from mock_vehicle.autopilot.plans import FRAME_MISSION, NO_PARAMS, Cmd, Item, Kind, Outcome
from mock_vehicle.autopilot.transfers import Transfer, ack, ask, complain, is_ours
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

MISSION_COUNT = wire.message("MISSION_COUNT")
MISSION_ITEM = wire.message("MISSION_ITEM")
MISSION_ITEM_INT = wire.message("MISSION_ITEM_INT")

REQUEST_COMPLAINT = "got MISSION_REQUEST; use MISSION_REQUEST_INT!"


def on_request_list(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Tell how many items there are."""
    v, client = frame.values, (frame.sysid, frame.compid)
    plans = autopilot.plans
    if not is_ours(autopilot, v):
        return
    if v.mission_type not in plans.rules.capacity:
        ack(autopilot, client, v.mission_type, Outcome.UNSUPPORTED)
    elif plans.transfer is not None and plans.transfer.is_upload:
        if not plans.rules.has_sessions:
            ack(autopilot, client, v.mission_type, Outcome.DENIED)
    else:
        length = len(plans.stored[v.mission_type])
        if plans.rules.has_sessions and length:
            session = (v.mission_type, client, autopilot.to[0], 0, length - 1, now, now)
            plans.transfer = Transfer(*session, is_upload=False)
        autopilot.send(MISSION_COUNT, *client, length, v.mission_type)


def on_request(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Send an item in whole numbers."""
    _give(autopilot, frame, is_float=False, now=now)


def on_float_request(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Send an item in the outdated form."""
    if _give(autopilot, frame, is_float=True, now=now):
        complain(autopilot, REQUEST_COMPLAINT, now)


def _give(autopilot: Autopilot, frame: wire.Frame, *, is_float: bool, now: float) -> bool:
    """Send the item that was asked for, if it may be had now."""
    v, client = frame.values, (frame.sysid, frame.compid)
    plans = autopilot.plans
    if not is_ours(autopilot, v) or v.mission_type not in plans.rules.capacity:
        return False
    transfer, items = plans.transfer, plans.stored[v.mission_type]
    if plans.rules.has_sessions:
        if not _is_in_turn(transfer, frame):
            return False
        plans.speaks_floats = is_float
        transfer.heard_at, transfer.next = now, v.seq + 1
    elif transfer is not None:
        ack(autopilot, client, v.mission_type, Outcome.DENIED)
        return False
    elif v.seq >= len(items):
        autopilot.send(MISSION_COUNT, *client, len(items), v.mission_type)
        ack(autopilot, client, v.mission_type, Outcome.INVALID_SEQUENCE)
        return False
    _send_item(autopilot, client, v.mission_type, v.seq, is_float=is_float)
    return True


def _is_in_turn(transfer: Transfer | None, frame: wire.Frame) -> TypeGuard[Transfer]:
    """Whether a session expects this request; the last item may be asked for again."""
    v = frame.values
    return (
        transfer is not None
        and not transfer.is_upload
        and transfer.partner == (frame.sysid, frame.compid)
        and v.mission_type == transfer.kind
        and v.seq in {transfer.next, transfer.next - 1}
        and v.seq <= transfer.last
    )


def _send_item(
    autopilot: Autopilot, client: tuple[int, int], kind: int, sequence: int, *, is_float: bool
) -> None:
    rules = autopilot.plans.rules
    item = autopilot.plans.stored[kind][sequence]
    if kind == Kind.MISSION and sequence == 0 and rules.has_home:
        item = home_item(autopilot)
    is_current = sequence == autopilot.progress.current and (sequence or not rules.has_home)
    autocontinue = 0 if rules.has_sessions and kind != Kind.MISSION else item.autocontinue
    message, frame = MISSION_ITEM_INT, item.frame
    place: tuple[float, float] = (item.x, item.y)
    if is_float:
        scale = 1.0 if frame == FRAME_MISSION else 1e-7
        message, frame = MISSION_ITEM, rules.float_frames.get(frame, frame)
        place = (item.x * scale, item.y * scale)
    head = (*client, sequence, frame, item.command, int(is_current), autocontinue)
    autopilot.send(message, *head, *item.params, *place, item.z, kind)


def home_item(autopilot: Autopilot) -> Item:
    """Give home as the item that ArduPilot keeps first."""
    home = autopilot.origin.to_global(*autopilot.navigation.home_m)
    place = (round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7))
    return Item(0, Cmd.NAV_WAYPOINT, NO_PARAMS, *place, home.amsl_m)


def on_ack(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """End a download, or obey a client that gives up."""
    v, transfer = frame.values, autopilot.plans.transfer
    is_partner = transfer is not None and transfer.partner == (frame.sysid, frame.compid)
    if transfer is None or not is_partner or v.mission_type != transfer.kind:
        return
    if not transfer.is_upload or v.type == Outcome.OPERATION_CANCELLED:
        autopilot.plans.transfer = None
    elif v.type == Outcome.UNSUPPORTED and autopilot.plans.rules.has_sessions:
        # the client does not know this kind of request
        autopilot.plans.speaks_floats = not autopilot.plans.speaks_floats
        ask(autopilot, transfer, now)
