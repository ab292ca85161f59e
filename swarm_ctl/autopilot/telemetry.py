"""The latest of what an autopilot told, with the time it was told."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from swarm_ctl import wire
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.base import ARMED_FLAG, Autopilot
from swarm_ctl.autopilot.command import Ack
from swarm_ctl.autopilot.complaints import PREARM_CHECK, Complaints, unhealthy
from swarm_ctl.autopilot.events import Events
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.autopilot.streams import Streams
from swarm_ctl.autopilot.texts import Text, Texts
from swarm_ctl.frames import Geodetic, body_to_ned, rotate, turn, wrap_rad
from swarm_ctl.model import ZERO, Vec3

AUTOPILOT_COMPONENT = 1
RADIO_COMPONENT = 68
COMPANION_COMPONENT = 191

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
    "TUNNEL",
)
SCAN_HZ = {"OBSTACLE_DISTANCE": 5.0}
"""What one with a memory wants, too; without it, it learns of walls only by being stopped."""

RANGE_BY_ORIENTATION = {0: 0, 12: 1, 6: 2, 2: 3, 24: 4, 25: 5}
"""MAV_SENSOR_ORIENTATION of the front, back, left, right, up and down rangefinders."""
CUSTOM_ORIENTATION = 100
BODY_FRD = 12
STEADY_RAD_S = 0.3
"""A scan taken while the vehicle turns faster is smeared: 0.1 s late is 2 degrees off."""
JUMP_M, JUMP_WITHIN_S = 1.0, 1.0
"""A position this far from where the last one and the velocity lead to has jumped."""
MOVING_M_S = 0.05
"""Who moves and is where it was has telemetry that hangs."""
STANDBY, ACTIVE, CRITICAL, EMERGENCY, TERMINATED = 3, 4, 5, 6, 8
GOOD_ESTIMATE = 1 | 2 | 4 | 8
"""Flags of both estimators: attitude, velocity level and vertical, position from the start.

ArduPilot flies with 831; when GNSS is gone it tells 37, then 167. PX4 flies with 831 or 895."""
INTENT_S = 2.0
"""How old word of the chosen mode may be when a mode is told; PX4 gives it twice a second."""

AUTOPILOTS: dict[int, Autopilot] = {pilot.heartbeat_id: pilot for pilot in (PX4, ARDUPILOT)}
_ID = {name: wire.message(name).id for name in SUBSCRIBED}


class PeerFix(NamedTuple):
    """A peer as the vehicle's own radio measured it."""

    sysid: int
    offset_ned_m: Vec3
    """From this vehicle to the peer."""


class VictimFix(NamedTuple):
    """A victim as the infrared sensor sees it."""

    number: int
    position_ned_m: Vec3
    """In the vehicle's own local frame."""


class Telemetry:
    """Latest values of one vehicle; times are mission time, -inf for never."""

    def __init__(self, sysid: int, yaw_offset_rad: float = 0.0) -> None:
        """Turn all that is heard, whose estimator's x axis points so far clockwise from north."""
        self.sysid = sysid
        self.streams = Streams()
        self.autopilot: Autopilot | None = None
        self.heard_s = self.heartbeat_s = -math.inf
        self.position_s = self.attitude_s = -math.inf
        self.mode_s = -math.inf
        """When the mode was told last, by HEARTBEAT or CURRENT_MODE."""
        self.armed, self.custom_mode = False, -1
        self.intended_mode = -1
        """What its user chose, as PX4 tells it; a failsafe flies another mode meanwhile."""
        self.intended_s = -math.inf
        self.system_status = 0
        self.prearm_ok: bool | None = None
        """Whether the checks before arming pass; None when it does not tell."""
        self.unhealthy: list[str] = []
        """The sensors in use that are not healthy."""
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
        self.ranges_m = [math.inf] * 6
        self.ranges_s = [-math.inf] * 6
        self.scan_m: list[Vec3] = []
        """What the scanner hit, from the vehicle, level, along north and east."""
        self.scan_s = -math.inf
        self.jump_m = 0.0
        """By how much the estimate jumped last, and when."""
        self.jump_s = -math.inf
        self.estimate_ok: bool | None = None
        """Whether the estimator trusts its position; None when it does not tell."""
        self.estimate_s = -math.inf
        self._boot_ms: dict[str, int] = {}
        self.battery_fraction: float | None = None
        self.peer_fixes: list[PeerFix] = []
        self.victim_fixes: list[VictimFix] = []
        self.texts: list[Text] = []
        """What it said since the agent looked last."""
        self.acks: list[Ack] = []
        self.events = Events()
        self._chunks = Texts()
        self._complaints = Complaints()
        self._yaw_offset_rad = yaw_offset_rad
        self._handlers = {
            _ID["HEARTBEAT"]: self._heartbeat,
            _ID["CURRENT_MODE"]: self._current_mode,
            _ID["SYS_STATUS"]: self._sys_status,
            _ID["BATTERY_STATUS"]: self._battery_status,
            _ID["ESTIMATOR_STATUS"]: self._estimate,
            _ID["EKF_STATUS_REPORT"]: self._estimate,
            _ID["ATTITUDE"]: self._attitude,
            _ID["LOCAL_POSITION_NED"]: self._local_position,
            _ID["DISTANCE_SENSOR"]: self._distance,
            _ID["LANDING_TARGET"]: self._landing_target,
            _ID["OBSTACLE_DISTANCE"]: self._scan,
            _ID["COMMAND_ACK"]: self._ack,
            _ID["STATUSTEXT"]: self._text,
            _ID["EVENT"]: self._event,
            _ID["GPS_GLOBAL_ORIGIN"]: self._origin,
        }

    @property
    def is_ready(self) -> bool:
        """Whether the autopilot says that it would arm."""
        if self.prearm_ok is None and self.events.may_arm is None:
            return self.system_status in {STANDBY, ACTIVE}
        return bool(self.prearm_ok or self.events.may_arm)

    @property
    def is_offboard(self) -> bool:
        """Whether the autopilot obeys the companion's setpoints."""
        return self.autopilot is not None and self.custom_mode == self.autopilot.offboard_mode

    @property
    def boot_s(self) -> float:
        """What the autopilot's own clock said with its last position, since its boot."""
        return self._boot_ms.get("LOCAL_POSITION_NED", 0) / 1000.0

    @property
    def is_landing(self) -> bool:
        """Whether the autopilot lands by itself."""
        return self.autopilot is not None and self.custom_mode == self.autopilot.land_mode

    @property
    def is_failsafe(self) -> bool:
        """Whether a failsafe of the autopilot's own flies it, and no pilot chose its mode."""
        if self.system_status in {EMERGENCY, TERMINATED}:
            return True
        if self.mode_s - self.intended_s < INTENT_S:
            return self.custom_mode != self.intended_mode
        pilot = self.autopilot
        chooses = pilot is not None and self.custom_mode in pilot.failsafe_modes
        return self.system_status == CRITICAL and (chooses or self.is_offboard)

    @property
    def mode_name(self) -> str:
        """Name the mode the autopilot is in."""
        return self.autopilot.mode_name(self.custom_mode) if self.autopilot else "unknown"

    @property
    def height_m(self) -> float:
        """Height above the vehicle's own start."""
        return -self.position_ned_m.z

    @property
    def yaw_rad(self) -> float:
        """Heading, clockwise from north."""
        return self.attitude_rad.z

    def why_not(self, now: float) -> str:
        """Say what the vehicle itself has against flying, in words; empty when nothing."""
        reasons = [*self.events.barriers, *self._complaints.recent(now), *self.unhealthy]
        return "; ".join(dict.fromkeys(reasons))

    def start_here(self) -> None:
        """Make the place where the vehicle is the origin of its positions."""
        start, place = self.start_ned_m, self.position_ned_m
        self.start_ned_m = Vec3(start.x + place.x, start.y + place.y, start.z + place.z)
        self.position_ned_m = ZERO

    def receive(self, frame: wire.Frame, now: float) -> None:
        """Take one frame of the vehicle's own autopilot or radio."""
        if frame.compid == RADIO_COMPONENT:
            if frame.id == _ID["DISTANCE_SENSOR"]:
                self._peer_distance(frame.values)
            return
        if frame.compid != AUTOPILOT_COMPONENT:
            return
        self.heard_s = now
        self.streams.heard(frame.id, now)
        handler = self._handlers.get(frame.id)
        if handler is not None:
            handler(frame.values, now)

    def _heartbeat(self, values: Any, now: float) -> None:
        self.heartbeat_s = self.mode_s = now
        pilot = AUTOPILOTS.get(values.autopilot)
        if pilot is not None and pilot is not self.autopilot:
            self.autopilot = pilot
            self.streams.want(pilot.streams_hz)
        self.armed = bool(values.base_mode & ARMED_FLAG)
        self.custom_mode = values.custom_mode
        self.system_status = values.system_status

    def _current_mode(self, values: Any, now: float) -> None:
        self.mode_s = self.intended_s = now
        self.custom_mode, self.intended_mode = values.custom_mode, values.intended_custom_mode

    def _sys_status(self, values: Any, _now: float) -> None:
        present, enabled, health = values[:3]
        self.unhealthy = unhealthy(present, enabled, health)
        tells = self.prearm_ok is not None or (present | health) & PREARM_CHECK
        self.prearm_ok = bool(health & PREARM_CHECK) if tells else None
        self._charge(values.battery_remaining)

    def _battery_status(self, values: Any, _now: float) -> None:
        if values.id == 0:
            self._charge(values.battery_remaining)

    def _charge(self, percent: int) -> None:
        """Take the charge in percent; -1 is one that is not measured."""
        if percent >= 0:
            self.battery_fraction = percent / 100.0

    def _estimate(self, values: Any, now: float) -> None:
        self.estimate_ok = values.flags & GOOD_ESTIMATE == GOOD_ESTIMATE
        self.estimate_s = now

    def _is_repeated(self, message: str, boot_ms: int) -> bool:
        """Whether a stream has stopped and says the same again and again."""
        before, self._boot_ms[message] = self._boot_ms.get(message), boot_ms
        return boot_ms == before != 0

    def _attitude(self, values: Any, now: float) -> None:
        attitude = Vec3(values.roll, values.pitch, values.yaw)
        is_repeated = self._is_repeated("ATTITUDE", values.time_boot_ms)
        if all(map(math.isfinite, attitude)) and not is_repeated:
            yaw_rad = wrap_rad(attitude.z + self._yaw_offset_rad)
            self.attitude_rad = Vec3(attitude.x, attitude.y, yaw_rad)
            self.yaw_rate_rad_s = values.yawspeed
            self.attitude_s = now

    def _local_position(self, values: Any, now: float) -> None:
        place = turn(Vec3(values.x, values.y, values.z), self._yaw_offset_rad)
        velocity = turn(Vec3(values.vx, values.vy, values.vz), self._yaw_offset_rad)
        start = self.start_ned_m
        position = Vec3(place.x - start.x, place.y - start.y, place.z - start.z)
        is_repeated = self._is_repeated("LOCAL_POSITION_NED", values.time_boot_ms)
        if math.hypot(*velocity) > MOVING_M_S:
            is_repeated |= (position, velocity) == (self.position_ned_m, self.velocity_ned_m_s)
        if is_repeated or not all(map(math.isfinite, (*position, *velocity))):
            return
        age_s = now - self.position_s
        if age_s < JUMP_WITHIN_S:
            jump_m = math.dist(position, self.position_ned_m) - age_s * math.hypot(*velocity)
            if jump_m > JUMP_M:
                self.jump_m, self.jump_s = jump_m, now
        self.position_ned_m, self.velocity_ned_m_s = position, velocity
        self.position_s = now

    def _distance(self, values: Any, now: float) -> None:
        index = RANGE_BY_ORIENTATION.get(values.orientation)
        if index is None:
            return
        beyond = values.current_distance >= values.max_distance
        self.ranges_m[index] = math.inf if beyond else values.current_distance * 0.01
        self.ranges_s[index] = now

    def _scan(self, values: Any, now: float) -> None:
        increment = math.radians(values.increment_f or values.increment)
        first = self.yaw_rad + math.radians(values.angle_offset)
        if values.frame != BODY_FRD or not math.isfinite(first + increment):
            return
        if abs(self.yaw_rate_rad_s) > STEADY_RAD_S:
            return
        self.scan_s = now
        self.scan_m = [
            Vec3(cm * 0.01 * math.cos(bearing), cm * 0.01 * math.sin(bearing), 0.0)
            for index, cm in enumerate(values.distances)
            if values.min_distance <= cm <= values.max_distance
            for bearing in (first + index * increment,)
        ]

    def _peer_distance(self, values: Any) -> None:
        if values.orientation != CUSTOM_ORIENTATION or not values.id:
            return
        ahead = Vec3(values.current_distance * 0.01, 0.0, 0.0)
        offset = body_to_ned(rotate(values.quaternion, ahead), *self.attitude_rad)
        if all(map(math.isfinite, offset)):
            self.peer_fixes.append(PeerFix(values.id, offset))

    def _landing_target(self, values: Any, _now: float) -> None:
        if not values.position_valid:
            return
        x, y, z = body_to_ned(Vec3(values.x, values.y, values.z), *self.attitude_rad)
        if all(map(math.isfinite, (x, y, z))):
            own = self.position_ned_m
            position = Vec3(own.x + x, own.y + y, own.z + z)
            self.victim_fixes.append(VictimFix(values.target_num, position))

    def _ack(self, values: Any, _now: float) -> None:
        """Take what answers us; in MAVLink 1, and from old firmware, nobody is addressed."""
        for_us = values.target_system in {0, self.sysid}
        if for_us and values.target_component in {0, COMPANION_COMPONENT}:
            self.acks.append(Ack(values.command, values.result, values.progress))

    def _origin(self, values: Any, _now: float) -> None:
        latitude_deg, longitude_deg = values.latitude * 1e-7, values.longitude * 1e-7
        is_nowhere = values.latitude == values.longitude == 0  # no satellite has told it yet
        if not is_nowhere and abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0:
            self.origin = Geodetic(latitude_deg, longitude_deg, values.altitude * 1e-3)

    def _text(self, values: Any, now: float) -> None:
        for text in self._chunks.hear(values, now):
            self._say(text, now)

    def _event(self, values: Any, now: float) -> None:
        text = self.events.hear(values)
        if text is not None:
            self._say(text, now)

    def _say(self, text: Text, now: float) -> None:
        self.texts.append(text)
        self._complaints.hear(text, now)
