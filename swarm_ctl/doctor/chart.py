"""What one vehicle has said while it was examined."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from swarm_ctl import wire
from swarm_ctl.autopilot.base import Autopilot
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.autopilot.telemetry import CUSTOM_ORIENTATION, Telemetry

RC_RECEIVER = 0x10000
"""MAV_SYS_STATUS_SENSOR_RC_RECEIVER."""
_SIGNED = 0x01
_ID = {
    name: wire.message(name).id
    for name in (
        *("HEARTBEAT", "AUTOPILOT_VERSION", "SYS_STATUS", "GPS_RAW_INT", "ATTITUDE"),
        *("ESTIMATOR_STATUS", "EKF_STATUS_REPORT", "DISTANCE_SENSOR"),
    )
}


@dataclass(slots=True)
class Ranges:
    """The readings of one rangefinder."""

    readings_cm: Counter[int] = field(default_factory=Counter)
    nearest_cm: int = 0
    farthest_cm: int = 0
    invalid: int = 0
    """Readings that it said itself are none (signal quality 1)."""

    @property
    def count(self) -> int:
        """Give the number of readings."""
        return self.readings_cm.total()

    @property
    def nearest_m(self) -> float:
        """Give what it measures at least."""
        return self.nearest_cm * 0.01

    @property
    def farthest_m(self) -> float:
        """Give what it measures at most."""
        return self.farthest_cm * 0.01

    def add(self, values: Any) -> None:
        """Take one DISTANCE_SENSOR."""
        self.readings_cm[values.current_distance] += 1
        self.nearest_cm, self.farthest_cm = values.min_distance, values.max_distance
        self.invalid += values.signal_quality == 1


class Chart:
    """The latest values of one autopilot, and what was counted while it was measured."""

    def __init__(self, sysid: int, place: str) -> None:
        """Begin for an autopilot that is heard at a place: an address, and who sends there."""
        self.sysid = sysid
        self.place = place
        self.telemetry = Telemetry(sysid)
        self.heartbeat: Any = None
        self.status: Any = None
        self.version: Any = None
        self.uids: set[str] = set()
        """Different ones mean different vehicles."""
        self.estimator: int | None = None
        """ESTIMATOR_STATUS_FLAGS or EKF_STATUS_FLAGS, which are alike."""
        self.gnss_fix: int | None = None
        self.reasons = ""
        """What it had against flying at the end of the measurement, in its own words."""
        self.ground_stations: set[int] = set()
        """sysids of those that are heard beside it."""
        self.rivals = 0
        """Heartbeats of another companion of this vehicle."""
        self.is_signed = False
        self.is_answering = False
        self.refused = 0
        """Frames that came unsigned, or signed with another key."""
        self.round_trips_s: list[float] = []
        self.clock: list[tuple[float, float]] = []
        """Pairs of our time and the vehicle's, the first and the latest, in seconds."""
        self.counts: Counter[int] = Counter()
        """Messages by id while it was measured."""
        self.ranges: dict[int, Ranges] = {}
        """By orientation, while it was measured."""
        self.measured_s = 0.0
        self.frames = 0
        self.lost = 0
        self.bytes_s = 0.0
        """Of the whole link."""
        self.is_measuring = False
        self._handlers: dict[int, Callable[[Any, float], None]] = {
            _ID["HEARTBEAT"]: self._heartbeat,
            _ID["AUTOPILOT_VERSION"]: self._autopilot_version,
            _ID["SYS_STATUS"]: self._sys_status,
            _ID["GPS_RAW_INT"]: self._gnss,
            _ID["ESTIMATOR_STATUS"]: self._estimator,
            _ID["EKF_STATUS_REPORT"]: self._estimator,
            _ID["DISTANCE_SENSOR"]: self._distance,
            _ID["ATTITUDE"]: self._attitude,
        }

    @property
    def autopilot(self) -> Autopilot | None:
        """Which of those that we fly it is."""
        return self.telemetry.autopilot

    @property
    def is_px4(self) -> bool:
        """Whether it is one of PX4's."""
        return self.autopilot is PX4

    @property
    def armed(self) -> bool:
        """Whether it is armed, by its latest heartbeat."""
        return self.telemetry.armed

    @property
    def has_pilot(self) -> bool:
        """Whether a transmitter is there and heard."""
        status = self.status
        return bool(
            status
            and status.onboard_control_sensors_present & RC_RECEIVER
            and status.onboard_control_sensors_health & RC_RECEIVER
        )

    @property
    def clock_rate(self) -> float | None:
        """Give how fast the vehicle's clock goes by ours, None while too little is known."""
        if len(self.clock) < 2 or self.clock[1][0] - self.clock[0][0] < 1.0:
            return None
        (began_s, vehicle_began_s), (now_s, vehicle_s) = self.clock
        return (vehicle_s - vehicle_began_s) / (now_s - began_s)

    def rate_hz(self, name: str) -> float:
        """Give the measured rate of a message."""
        return self.counts[wire.message(name).id] / max(self.measured_s, 0.1)

    def receive(self, frame: wire.Frame, now: float) -> None:
        """Take a frame of the autopilot."""
        self.is_signed = bool(frame.raw[0] == 0xFD and frame.raw[2] & _SIGNED)
        self.sense(frame, now)

    def sense(self, frame: wire.Frame, now: float) -> None:
        """Take a frame of the autopilot, or of a sensor that speaks for itself."""
        self.telemetry.receive(frame, now)
        if self.is_measuring:
            self.counts[frame.id] += 1
        handler = self._handlers.get(frame.id)
        if handler is not None:
            handler(frame.values, now)

    def _heartbeat(self, values: Any, _now: float) -> None:
        self.heartbeat = values

    def _autopilot_version(self, values: Any, _now: float) -> None:
        self.version = values
        uid = values.uid2.hex() if any(values.uid2) else f"{values.uid:016x}"
        self.uids.add(uid)

    def _sys_status(self, values: Any, _now: float) -> None:
        self.status = values

    def _gnss(self, values: Any, _now: float) -> None:
        self.gnss_fix = values.fix_type

    def _estimator(self, values: Any, _now: float) -> None:
        self.estimator = values.flags

    def _distance(self, values: Any, _now: float) -> None:
        if self.is_measuring and values.orientation != CUSTOM_ORIENTATION:
            self.ranges.setdefault(values.orientation, Ranges()).add(values)

    def _attitude(self, values: Any, now: float) -> None:
        if self.is_measuring:
            self.clock[1:] = [(now, values.time_boot_ms * 1e-3)]
