"""The mission protocol: what an autopilot listens to, and its timers.

https://mavlink.io/en/services/mission.html, as each autopilot was recorded to speak it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import downloads, progress, uploads
from mock_vehicle.autopilot.traits import Severity
from mock_vehicle.autopilot.transfers import ask, end, tell_totals
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot
    from mock_vehicle.autopilot.commands import MessageHandler

ROUNDING_S = 1e-6
"""Times of steps are sums of floats."""


def watch(autopilot: Autopilot, now: float) -> None:
    """Tell what has changed, ask again for what does not come, and give up in the end."""
    transfer, rules = autopilot.plans.transfer, autopilot.plans.rules
    if autopilot.plans.untold:
        tell_totals(autopilot)
    if transfer is None:
        return
    with autopilot.serving(transfer.link):
        if now - transfer.heard_at >= rules.timeout_s:
            end(autopilot, rules.timeout_result)
            if rules.timeout_text:
                autopilot.say(Severity.WARNING, rules.timeout_text, now)
        elif transfer.is_upload and now - transfer.asked_at >= rules.retry_s - ROUNDING_S:
            ask(autopilot, transfer, now)


MESSAGES: Mapping[int, MessageHandler] = {
    wire.message("MISSION_ACK").id: downloads.on_ack,
    wire.message("MISSION_CLEAR_ALL").id: uploads.on_clear_all,
    wire.message("MISSION_COUNT").id: uploads.on_count,
    wire.message("MISSION_ITEM").id: uploads.on_float_item,
    wire.message("MISSION_ITEM_INT").id: uploads.on_item,
    wire.message("MISSION_REQUEST").id: downloads.on_float_request,
    wire.message("MISSION_REQUEST_INT").id: downloads.on_request,
    wire.message("MISSION_REQUEST_LIST").id: downloads.on_request_list,
    wire.message("MISSION_SET_CURRENT").id: progress.on_set_current,
}
"""What both autopilots listen to, by message id."""
