"""The frame that a mission's vehicles share, if any, and where each one's own frame lies in it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from swarm_ctl.autopilot.telemetry import Telemetry
from swarm_ctl.frames import Geodetic, enu_to_ned, geodetic_to_ned, ned_to_geodetic
from swarm_ctl.model import ZERO, Vec3
from swarm_ctl.sections import Section

ASK_S, ASK_TIMES = 2.0, 3
"""Between two requests for an origin; how many before an autopilot without one is told one."""
FAR_M = 100_000.0
"""Who claims to have started farther away than this is no member of the swarm."""

GNSS_HEIGHT_DOUBT_M = 5.0
"""Heights by satellites differ by metres between receivers side by side."""

Sysid = Annotated[int, Field(strict=False, ge=1, le=255)]
Point = Annotated[tuple[float, float, float], Field(strict=False)]
Turn = Annotated[float, Field(ge=-360.0, le=360.0)]
Place = Vec3 | Geodetic
"""Where a vehicle started: NED in the surveyed frame, or on the globe."""


class FrameParams(Section):
    """The frame that the vehicles of a mission share, if any."""

    shared: Literal["none", "surveyed", "gnss"] = "none"
    """How vehicles know where a peer is, beside what the radio measures: not at all (`none`), by
    surveyed starts (`surveyed`), or by the origins that satellites gave (`gnss`)."""
    starts_m: dict[Sysid, Point] = Field(default_factory=dict)
    """Surveyed start of each vehicle by its sysid, as in world files: x east, y north, z up."""
    yaw_offset_deg: dict[Sysid, Turn] = Field(default_factory=dict)
    """Where the x axis of a vehicle's estimator points, in degrees clockwise from north.

    For vision or motion capture without a compass; who is not listed has its x to the north."""
    origin: Point | None = None
    """Latitude and longitude in degrees, altitude in metres, of the place from which `starts_m`
    count: told to autopilots that know no origin of their own, as ArduPilot without satellites."""


def mistakes(frame: FrameParams) -> Iterator[tuple[str, str]]:
    """Name every key that does not fit another one, with a sentence."""
    if frame.shared == "surveyed":
        if not frame.starts_m:
            yield "frame.starts_m", "is missing; it says where each vehicle starts"
        if len(set(frame.starts_m.values())) < len(frame.starts_m):
            yield "frame.starts_m", "puts two vehicles at one place"
    elif frame.starts_m:
        yield "frame.starts_m", f"needs `shared: surveyed`, not {frame.shared}"
    if frame.shared == "gnss" and frame.yaw_offset_deg:
        yield "frame.yaw_offset_deg", "needs no satellites: with `shared: gnss` all axes lie north"
    if frame.origin is None:
        return
    latitude, longitude, _ = frame.origin
    if frame.shared == "gnss":
        yield "frame.origin", "would put every vehicle at one place; `shared: gnss` needs their own"
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        yield "frame.origin", "must be a latitude, a longitude and an altitude, as [47.4, 8.5, 488]"


class Shift(NamedTuple):
    """What to add to a position that a peer tells, to have it from the own start."""

    offset_m: Vec3
    """North, east, down."""
    height_doubt_m: float = 0.0
    """How wrong its height may be."""


def shift_between(own: Place | None, peer: Place | None) -> Shift | None:
    """Give the shift between two frames; None when they have nothing in common."""
    match own, peer:
        case Geodetic(), Geodetic():
            level = geodetic_to_ned(peer, own)
            # autopilots count heights along the curved Earth, and not from a tangent plane
            found = Shift(Vec3(level.x, level.y, own[2] - peer[2]), GNSS_HEIGHT_DOUBT_M)
        case Vec3(), Vec3():
            found = Shift(Vec3(*(p - o for p, o in zip(peer, own, strict=True))))
        case _:
            return None
    return found if math.hypot(*found.offset_m) < FAR_M else None


class SharedFrame:
    """Where one vehicle's own frame lies in the shared one."""

    def __init__(self, params: FrameParams, sysid: int) -> None:
        self._has_satellites = params.shared == "gnss"
        self.yaw_offset_rad = math.radians(params.yaw_offset_deg.get(sysid, 0.0))
        surveyed = params.starts_m.get(sysid)
        self._start = enu_to_ned(Vec3(*surveyed)) if surveyed else None
        self._origin = Geodetic(*params.origin) if params.origin else None
        self._ask_s, self._asked = -math.inf, 0

    def start(self, telemetry: Telemetry) -> Place | None:
        """Give the place of the vehicle's own start; None while nobody has told it."""
        if self._has_satellites and telemetry.origin is not None:
            return ned_to_geodetic(telemetry.start_ned_m, telemetry.origin)
        return self._start

    def lacks_origin(self, telemetry: Telemetry) -> bool:
        """Whether the mission wants an origin on the globe, and the autopilot has told none."""
        is_wanted = self._has_satellites or self._origin is not None
        return is_wanted and telemetry.origin is None

    def is_time_to_ask(self, telemetry: Telemetry, now: float) -> bool:
        """Whether an autopilot on the ground is to be asked where its own origin lies."""
        is_heard = telemetry.autopilot is not None
        if not is_heard or not self.lacks_origin(telemetry) or telemetry.armed or now < self._ask_s:
            return False
        self._ask_s = now + ASK_S
        self._asked += 1
        return True

    @property
    def origin_to_tell(self) -> Geodetic | None:
        """What to tell an autopilot that was asked and has said nothing; None while it may yet."""
        if self._origin is None or self._asked < ASK_TIMES:
            return None
        return ned_to_geodetic(self._start or ZERO, self._origin)
