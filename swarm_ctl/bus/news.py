"""What of a vehicle's events is news for people, and in which words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarm_ctl import model
from swarm_ctl.bus.messages import Event

MOST_SEVERE = 4
"""What an autopilot says is news from MAV_SEVERITY_WARNING on; a smaller number is worse."""
_ENDS = frozenset({"done", "failed"})

_WORDS: Mapping[str, tuple[str, str]] = {
    "PhaseChanged": ("phase", "{after}: {reason}"),
    "VictimFound": ("victim", "victim {victim} found"),
    "VictimHeard": ("victim", "victim {victim} found by vehicle {finder}, says {told_by}"),
    "PeerTooClose": ("contact", "a peer is only {distance_m} m away"),
    "PeerElsewhere": ("contact", "vehicle {peer} is {apart_m} m from where it says"),
    "LinkLost": ("fault", "its autopilot has been silent for {silent_s} s"),
    "LinkRegained": ("fault", "its autopilot is heard again"),
    "FenceLeft": ("fault", "outside its geofence"),
    "PlannerFailed": ("fault", "no plan: {error}"),
    "CommandRefused": ("fault", "command {command} refused: {reason}"),
    "StatusText": ("fault", "{text}"),
    "ControllerRestarted": ("fault", "its controller was away for {away_s} s while {phase}"),
    "JournalUnusable": ("fault", "{reason}"),
    "OperatorOrder": ("order", "{order} ordered"),
    "OrderRefused": ("order", "{order} refused: it is {phase}"),
}
"""Kind and words by name; the others come too often, or tell nothing without the record."""


def news(event: model.Event, run: str, number: int) -> Event | None:
    """Put an event as it is told with a number; None when it is no news."""
    name, data = event.name, event.data
    if name not in _WORDS or data.get("severity", 0) > MOST_SEVERE:
        return None
    kind, words = _WORDS[name]
    if data.get("after") in _ENDS:
        kind = "done"
    text = words.format_map(data).removesuffix(": ")
    return Event(run, event.sysid, number, event.time_s, kind, name, text, dict[str, Any](data))
