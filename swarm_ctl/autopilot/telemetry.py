"""The latest of what an autopilot told, with the time it was told."""

from __future__ import annotations

import math
from array import array
from typing import Any, NamedTuple

from swarm_ctl import wire
from swarm_ctl.autopilot.base import AUTOPILOT_COMPONENT, COMPANION_COMPONENT, RADIO_COMPONENT
from swarm_ctl.autopilot.status import MOST_NEWS, Status
from swarm_ctl.autopilot.timesync import Timesync
from swarm_ctl.frames import Geodetic, body_to_ned, rotate, wrap_rad
from swarm_ctl.model import ZERO, Vec3

SUBSCRIBED = (
    "HEARTBEAT",
    "CURRENT_MODE",
    "SYS_STATUS",
    "BATTERY_STATUS",
    "ESTIMATOR_STATUS",
    "EKF_STATUS_REPORT",
    "ATTITUDE",
    "LOCAL_POSITION_NED",
    "DISTANCE_SENSOR",
    "LANDING_TARGET",
    "OBSTACLE_DISTANCE",
    "COMMAND_ACK",
    "STATUSTEXT",
    "EVENT",
    "GPS_GLOBAL_ORIGIN",
    "TIMESYNC",
    "TUNNEL",
)
SCAN_HZ = {"OBSTACLE_DISTANCE": 5.0}
"""What one with a memory wants, too; without it, it learns of walls only by being stopped."""

RANGE_BY_ORIENTATION = {0: 0, 4: 1, 12: 1, 6: 2, 2: 3, 24: 4, 25: 5}
"""MAV_SENSOR_ORIENTATION of the front, back, left, right, up and down rangefinders.

Back is half a turn of yaw in ArduPilot, of pitch in PX4."""
CUSTOM_ORIENTATION = 100
BODY_FRD = 12
STEADY_RAD_S = 0.3
"""A scan taken while the vehicle turns faster is smeared: 0.1 s late is 2 degrees off."""
JUMP_M, JUMP_WITHIN_S = 1.0, 1.0
"""A position this far from where the last one and the velocity lead to has jumped."""
FARTHEST_PEER_M = 656.0
"""What DISTANCE_SENSOR can say; a bearing that is no rotation leads farther."""
OLDEST_FIX_S = 1.0
"""Who tells of what was measured longer ago counts by another clock."""
OVERTAKEN_MS = 2000
"""What is older than the last of its kind by less was overtaken; by more, the clock began anew."""
ATTITUDES = 50
"""Kept for what the radio tells late; a second's worth at PX4's 50 Hz."""
_DISTANCE_SENSOR = wire.message("DISTANCE_SENSOR").id
_SENSED = frozenset({_DISTANCE_SENSOR, wire.message("OBSTACLE_DISTANCE").id})
_NO_SENSORS = frozenset({AUTOPILOT_COMPONENT, RADIO_COMPONENT, COMPANION_COMPONENT})


def is_sensed(frame: wire.Frame) -> bool:
    """Whether a rangefinder or scanner speaks for itself, and its autopilot only passes it on.

    PX4 tells of those on one link no more than the one that spoke last, ArduPilot of no scanner.
    """
    return frame.compid not in _NO_SENSORS and frame.id in _SENSED


class PeerFix(NamedTuple):
    """A peer as the vehicle's own radio measured it."""

    sysid: int
    offset_ned_m: Vec3
    """From this vehicle to the peer."""
    measured_s: float
    """Mission time of the measurement."""


class VictimFix(NamedTuple):
    """A victim as the infrared sensor sees it."""

    number: int
    position_ned_m: Vec3
    """In the vehicle's own local frame."""


class Scan(NamedTuple):
    """What a level scanner told, as it told it."""

    first_rad: float
    """Bearing of the first distance, clockwise from north."""
    increment_rad: float
    nearest_cm: int
    """Distances from here to `farthest_cm` were measured, others mean nothing."""
    farthest_cm: int
    distances_cm: tuple[int, ...]

    def hits(self, within_m: float) -> list[tuple[float, float, float]]:
        """Give what it hit, from the vehicle, level, along north and east.

        What lies farther than `within_m`, rounded up, is left out: only few hits are worth the
        sines and cosines.
        """
        first, increment, nearest, farthest, distances = self
        farthest = min(farthest, math.ceil(within_m * 100.0))
        if min(distances, default=math.inf) > farthest:
            return []
        return [
            (cm * 0.01 * math.cos(bearing), cm * 0.01 * math.sin(bearing), 0.0)
            for index, cm in enumerate(distances)
            if nearest <= cm <= farthest
            for bearing in (first + index * increment,)
        ]


class Telemetry(Status):
    """Latest values of one vehicle; times are mission time, -inf for never."""

    def __init__(self, sysid: int, yaw_offset_rad: float = 0.0) -> None:
        """Turn all that is heard, whose estimator's x axis points so far clockwise from north."""
        super().__init__(sysid)
        self.heard_s = self.position_s = self.attitude_s = -math.inf
        self.origin: Geodetic | None = None
        """Where on the globe the estimator's own frame begins; None when it has not told."""
        self.start_ned_m = ZERO
        """Where the vehicle stood before take-off, from where the estimator's own frame begins."""
        self.position_ned_m = ZERO
        """From the start."""
        self.velocity_ned_m_s = ZERO
        self.yaw_rate_rad_s = 0.0
        self.attitude_rad = ZERO
        """Roll, pitch, yaw."""
        self._attitudes = array("d")
        """The latest of them, the last one last: when each was heard, and its three angles."""
        self.timesync = Timesync()
        self.ranges_m = [math.inf] * 6
        self.ranges_s = [-math.inf] * 6
        self.ranges_from = [(ZERO, 0.0)] * 6
        """Where the vehicle was when each was told, and its heading, rad."""
        self.scan: Scan | None = None
        self.scan_s = -math.inf
        self.jump_m = 0.0
        """By how much the estimate jumped last, and when."""
        self.jump_s = -math.inf
        self._boot_ms: dict[str, int] = {}
        self._ranges_boot_ms = [0] * 6
        self.peer_fixes: list[PeerFix] = []
        self.victim_fixes: list[VictimFix] = []
        self._yaw_offset_rad = yaw_offset_rad
        self._cos, self._sin = math.cos(yaw_offset_rad), math.sin(yaw_offset_rad)
        self._listen(
            {
                "ATTITUDE": self._attitude,
                "LOCAL_POSITION_NED": self._local_position,
                "DISTANCE_SENSOR": self._distance,
                "LANDING_TARGET": self._landing_target,
                "OBSTACLE_DISTANCE": self._scan,
                "GPS_GLOBAL_ORIGIN": self._origin,
                "TIMESYNC": self._timesync,
            }
        )

    @property
    def boot_s(self) -> float:
        """What the autopilot's own clock said with its last position, since its boot."""
        return self._boot_ms.get("LOCAL_POSITION_NED", 0) / 1000.0

    @property
    def height_m(self) -> float:
        """Height above the vehicle's own start."""
        return -self.position_ned_m.z

    @property
    def yaw_rad(self) -> float:
        """Heading, clockwise from north."""
        return self.attitude_rad.z

    def forget_news(self) -> None:
        """Drop what waits to be taken note of."""
        for news in (self.peer_fixes, self.victim_fixes, self.texts, self.acks):
            news.clear()

    def start_here(self) -> None:
        """Make the place where the vehicle is the origin of its positions."""
        start, place = self.start_ned_m, self.position_ned_m
        self.start_ned_m = Vec3(start.x + place.x, start.y + place.y, start.z + place.z)
        self.position_ned_m = ZERO
        self.ranges_from = [(ZERO, yaw_rad) for _, yaw_rad in self.ranges_from]

    def receive(self, frame: wire.Frame, now: float) -> None:
        """Take one frame of the vehicle's own autopilot, radio, or a sensor that speaks itself."""
        _, compid, _, number, values, _ = frame
        if compid == AUTOPILOT_COMPONENT:
            self.heard_s = now
            self.streams.heard_s[number] = now
            handler = self._handlers.get(number)
            if handler is not None:
                handler(values, now)
        elif is_sensed(frame):
            self._handlers[number](values, now)
        elif compid == RADIO_COMPONENT and number == _DISTANCE_SENSOR:
            self._peer_distance(values, now)

    def _is_repeated(self, message: str, boot_ms: int) -> bool:
        """Whether a stream has stopped and says the same again and again, or was overtaken."""
        before = self._boot_ms.get(message, 0)
        if boot_ms < before and _is_overtaken(boot_ms, before):
            return True
        self._boot_ms[message] = boot_ms
        return boot_ms == before != 0

    def _attitude(self, values: Any, now: float) -> None:
        boot_ms, roll_rad, pitch_rad, yaw_rad, _, _, yaw_rate_rad_s = values
        is_repeated = self._is_repeated("ATTITUDE", boot_ms)
        if math.isfinite(roll_rad + pitch_rad + yaw_rad) and not is_repeated:
            yaw_rad = wrap_rad(yaw_rad + self._yaw_offset_rad)
            self.attitude_rad = Vec3(roll_rad, pitch_rad, yaw_rad)
            self.yaw_rate_rad_s = yaw_rate_rad_s
            self.attitude_s = now
            self._attitudes.extend((now, roll_rad, pitch_rad, yaw_rad))
            del self._attitudes[: -4 * ATTITUDES]

    def _local_position(self, values: Any, now: float) -> None:
        boot_ms, x, y, z, vx, vy, vz = values
        is_repeated = self._is_repeated("LOCAL_POSITION_NED", boot_ms)
        if is_repeated or not math.isfinite(x + y + z + vx + vy + vz):
            return
        (start_x, start_y, start_z), c, s = self.start_ned_m, self._cos, self._sin
        position = Vec3(c * x - s * y - start_x, s * x + c * y - start_y, z - start_z)
        velocity = Vec3(c * vx - s * vy, s * vx + c * vy, vz)
        # no estimate of who flies says the same twice: this telemetry hangs
        hangs = position == self.position_ned_m and velocity == self.velocity_ned_m_s
        if hangs and any(velocity):
            return
        age_s = now - self.position_s
        if age_s < JUMP_WITHIN_S:
            jump_m = math.dist(position, self.position_ned_m) - age_s * math.hypot(*velocity)
            if jump_m > JUMP_M:
                self.jump_m, self.jump_s = jump_m, now
        self.position_ned_m, self.velocity_ned_m_s = position, velocity
        self.position_s = now

    def _timesync(self, values: Any, now: float) -> None:
        if values.tc1:  # an answer; without it the autopilot asks
            self.timesync.answered(values.ts1, now)

    def _distance(self, values: Any, now: float) -> None:
        boot_ms, _, farthest_cm, distance_cm, _, _, orientation = values[:7]
        index = RANGE_BY_ORIENTATION.get(orientation)
        if index is None:
            return
        last_ms = self._ranges_boot_ms[index]
        if boot_ms < last_ms and _is_overtaken(boot_ms, last_ms):
            return
        self._ranges_boot_ms[index] = boot_ms
        self.ranges_m[index] = math.inf if distance_cm >= farthest_cm else distance_cm * 0.01
        self.ranges_s[index] = now
        self.ranges_from[index] = self.position_ned_m, self.attitude_rad[2]

    def _scan(self, values: Any, now: float) -> None:
        increment = math.radians(values.increment_f or values.increment)
        first = self.yaw_rad + math.radians(values.angle_offset)
        if values.frame != BODY_FRD or not math.isfinite(first + increment):
            return
        if abs(self.yaw_rate_rad_s) > STEADY_RAD_S:
            return
        limits_cm = values.min_distance, values.max_distance
        self.scan, self.scan_s = Scan(first, increment, *limits_cm, values.distances), now

    def _peer_distance(self, values: Any, now: float) -> None:
        if values.orientation != CUSTOM_ORIENTATION or not values.id:
            return
        age_s = self._age_s(values.time_boot_ms, now)
        ahead = rotate(values.quaternion, Vec3(values.current_distance * 0.01, 0.0, 0.0))
        offset = body_to_ned(ahead, *self._attitude_at(now - age_s))
        if math.hypot(*offset) <= FARTHEST_PEER_M:  # which NaN is not
            self.peer_fixes.append(PeerFix(values.id, offset, now - age_s))
            del self.peer_fixes[:-MOST_NEWS]

    def _age_s(self, boot_ms: int, now: float) -> float:
        """Give the age of what the radio tells; 0 when its clock is not the autopilot's."""
        before_s = (self._boot_ms.get("LOCAL_POSITION_NED", 0) - boot_ms) / 1000.0
        age_s = before_s + now - self.position_s
        return age_s if boot_ms and 0.0 < age_s <= OLDEST_FIX_S else 0.0

    def _attitude_at(self, then: float) -> Vec3:
        """Give the attitude of a moment ago: what was measured then was so in that body frame."""
        attitudes = self._attitudes
        for at in range(len(attitudes) - 4, -1, -4):
            if attitudes[at] <= then:
                return Vec3(*attitudes[at + 1 : at + 4])
        return self.attitude_rad

    def _landing_target(self, values: Any, _now: float) -> None:
        if not values.position_valid:
            return
        x, y, z = body_to_ned(Vec3(values.x, values.y, values.z), *self.attitude_rad)
        if all(map(math.isfinite, (x, y, z))):
            own = self.position_ned_m
            position = Vec3(own.x + x, own.y + y, own.z + z)
            self.victim_fixes.append(VictimFix(values.target_num, position))
            del self.victim_fixes[:-MOST_NEWS]

    def _origin(self, values: Any, _now: float) -> None:
        latitude_deg, longitude_deg = values.latitude * 1e-7, values.longitude * 1e-7
        is_nowhere = values.latitude == values.longitude == 0  # no satellite has told it yet
        if not is_nowhere and abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0:
            self.origin = Geodetic(latitude_deg, longitude_deg, values.altitude * 1e-3)


def _is_overtaken(boot_ms: int, last_ms: int) -> bool:
    """Whether something newer of its kind has come first; a clock that tells nothing says 0."""
    return boot_ms != 0 and 0 < last_ms - boot_ms < OVERTAKEN_MS
