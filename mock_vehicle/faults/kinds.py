"""Every kind of fault in one table: what it does, its parameters, whether it lasts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple


def _any_of(words: tuple[str, ...]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"


class Parameter(NamedTuple):
    """A number or a word that shapes a fault; its name carries the unit."""

    says: str
    default: float | str | None
    """None stands for what `says` says."""
    low: float = 0.0
    high: float = math.inf
    choices: tuple[str, ...] = ()
    """The words it may be; none for a number."""
    is_whole: bool = False

    def check(self, value: Any) -> None:
        """Raise ValueError for a value that cannot be."""
        if self.choices:
            if value not in self.choices:
                raise ValueError(f"should be {_any_of(self.choices)}, not {value!r}")
            return
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
            raise ValueError(f"should be a number, not {value!r}")
        if self.is_whole and value != int(value):
            raise ValueError(f"should be a whole number, not {value!r}")
        if not self.low <= value <= self.high:
            raise ValueError(f"should be {self.range}, not {value!r}")

    @property
    def range(self) -> str:
        """Say in words what it may be."""
        if self.choices:
            return _any_of(self.choices)
        if self.high < math.inf:
            return f"{self.low:g} to {self.high:g}"
        return f"{self.low:g} or more" if self.low > -math.inf else "any number"


class Kind(NamedTuple):
    """What a fault does to a vehicle."""

    says: str
    parameters: Mapping[str, Parameter] = {}
    lasts: bool = True
    """Whether it goes on for a while, and may be healed."""
    duration_s: float | None = None
    """How long it lasts unless told otherwise; None is for good."""


def _share(says: str, default: float) -> Parameter:
    return Parameter(says, default, high=1.0)


_COUNT = Parameter("how many; none: all, as long as it lasts", None, low=1, is_whole=True)
_FROM = "where it comes from, degrees counter-clockwise from east"
_TOWARDS = "where to, degrees counter-clockwise from east"
_ANSWER = Parameter(
    "which answer", "COMMAND_ACK", choices=("COMMAND_ACK", "MISSION_ACK", "PARAM_VALUE")
)
_PLACE = {
    "direction": Parameter(
        "uplink is to the vehicle", "both", choices=("both", "uplink", "downlink")
    ),
    "link": Parameter(
        "which of its links", "all", choices=("all", "companion", "ground-station", "viewer")
    ),
}

KINDS: Mapping[str, Kind] = {
    # the vehicle
    "motor": Kind("one motor stops: the vehicle drops, and its autopilot flies on"),
    "dead": Kind("the vehicle falls silent and drops", lasts=False),
    "wind-gust": Kind(
        "a gust blows it away",
        {
            "speed_m_s": Parameter("speed", 8.0),
            "from_deg": Parameter(_FROM, 0.0, low=-360.0, high=360.0),
        },
        duration_s=4.0,
    ),
    # the battery
    "battery": Kind(
        "its battery falls to a charge", {"fraction": _share("charge left", 0.1)}, lasts=False
    ),
    "battery-drain": Kind(
        "something draws power from its battery", {"power_w": Parameter("power", 200.0)}
    ),
    # sensors
    "rangefinder": Kind("its rangefinders stop reporting"),
    "rangefinder-stuck": Kind("its rangefinders repeat their last readings"),
    "rangefinder-noise": Kind(
        "its rangefinders are noisy", {"noise_m": Parameter("standard deviation", 0.3)}
    ),
    "gnss-loss": Kind("it has no satellite fix"),
    "gnss-glitch": Kind(
        "its satellite position jumps",
        {
            "offset_m": Parameter("how far", 10.0),
            "towards_deg": Parameter(_TOWARDS, 0.0, low=-360.0, high=360.0),
        },
    ),
    "drift": Kind(
        "its position estimate drifts",
        {
            "fraction": _share("drift per distance flown, beside the world's own", 0.1),
            "jump_m": Parameter("jump at once, which stays", 0.0),
            "towards_deg": Parameter("where the jump goes, as above", 0.0, low=-360.0, high=360.0),
        },
    ),
    # the autopilot
    "freeze": Kind("its autopilot is silent and obeys nothing, then is back", duration_s=5.0),
    "frozen-telemetry": Kind("its streams repeat an old state; commands work and it flies on"),
    "reboot": Kind("its autopilot starts again, motors off", lasts=False),
    "parameters-lost": Kind(
        "its parameters are back at their defaults, but the sysid", lasts=False
    ),
    "nack": Kind(
        "its autopilot refuses commands",
        {
            "command": Parameter("MAV_CMD; none: every command", None, high=0xFFFF, is_whole=True),
            "result": Parameter(
                "MAV_RESULT",
                "temporarily-rejected",
                choices=("temporarily-rejected", "denied", "unsupported", "failed"),
            ),
            "count": _COUNT,
        },
    ),
    "ack-late": Kind(
        "its acknowledgements come late", {"delay_s": Parameter("delay", 1.0), "message": _ANSWER}
    ),
    "ack-lost": Kind("its acknowledgements are lost", {"count": _COUNT, "message": _ANSWER}),
    # the radio between vehicles
    "silent-radio": Kind("its radio neither sends nor hears"),
    "radio-loss": Kind(
        "its radio loses frames, in both directions", {"fraction": _share("share lost", 0.5)}
    ),
    # the links to companion and ground station
    "link-loss": Kind("frames are lost", {"fraction": _share("share lost", 1.0), **_PLACE}),
    "link-delay": Kind(
        "frames are late",
        {
            "delay_s": Parameter("delay of every frame", 0.5),
            "jitter_s": Parameter("up to so much more, evenly: frames overtake others", 0.0),
            **_PLACE,
        },
    ),
    "link-burst": Kind(
        "frames are held and arrive in bursts",
        {"period_s": Parameter("time from burst to burst", 1.0, low=0.01), **_PLACE},
    ),
    "link-duplicate": Kind(
        "frames arrive twice", {"fraction": _share("share of them", 1.0), **_PLACE}
    ),
    "link-reorder": Kind(
        "some frames are held back and overtaken",
        {
            "fraction": _share("share of them", 0.25),
            "hold_s": Parameter("how long", 0.2),
            **_PLACE,
        },
    ),
    "link-freeze": Kind(
        "frames are held until it is over, then arrive at once", {**_PLACE}, duration_s=5.0
    ),
    # the mock
    "fleet": Kind("the mock itself dies without a word", lasts=False),
}
