"""A ground station and a pilot's hands on a vehicle's other link: pymavlink, socket, thread."""

from __future__ import annotations

import contextlib
import math
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sitl.simulators import Simulator

PATIENCE_S = 20.0
READY_S = 90.0
"""An ArduCopter knows its position 42 s after its start."""
BEAT_S, STICKS_S = 0.5, 0.05
COPTER_MODES = {"STABILIZE": 0, "GUIDED": 4, "LOITER": 5, "RTL": 6, "LAND": 9}
PX4_MODES = {"POSCTL": (3, 0), "AUTO.LOITER": (4, 3), "AUTO.RTL": (4, 5), "AUTO.LAND": (4, 6)}
INT32, PREARM_CHECK = 6, 0x10000000
COMPANION, STATION, TRACKER = 191, 255, 254

Settings = Mapping[str, float]
"""Values of parameters; versions that do not know one of several names know another."""


class Station:
    """Hears all that a vehicle sends on this link; says only what the test lets it say."""

    def __init__(self, vehicle: Simulator) -> None:
        self.vehicle = vehicle
        self.beats = False
        """Whether its heartbeats go out: without them the vehicle knows of no ground station."""
        self.holds_sticks = False
        """Whether somebody holds the sticks, centred."""
        self.latest: dict[str, Any] = {}
        self.texts: deque[str] = deque(maxlen=200)
        self.acks: deque[Any] = deque(maxlen=200)
        self._codec = mavlink.MAVLink(None, srcSystem=STATION, srcComponent=190)
        self._codec.robust_parsing = True
        self._ends = threading.Event()
        self._address: Any = None
        self._thread = threading.Thread(target=self._live, daemon=True)

    def opens(self) -> None:
        self.vehicle.station.settimeout(STICKS_S)
        if self.vehicle.autopilot == "px4":
            self._address = self.vehicle.station.getpeername()
        self._thread.start()

    def closes(self) -> None:
        self._ends.set()
        self._thread.join()

    # What is heard.

    def waits(self, done: Callable[[], object], what: str, within_s: float = PATIENCE_S) -> float:
        """Wait until something is so; give how long it took."""
        began = time.monotonic()
        while not done():
            took_s = time.monotonic() - began
            assert took_s < within_s, f"{what}: not within {within_s:g} s; {list(self.texts)[-5:]}"
            self._ends.wait(0.01)
        return time.monotonic() - began

    @property
    def sysid(self) -> int:
        return self.vehicle.sysid

    @property
    def place(self) -> tuple[float, float, float]:
        """Give where the vehicle says it is, NED from the origin of its estimator."""
        told = self.latest["LOCAL_POSITION_NED"]
        return told.x, told.y, told.z

    @property
    def is_armed(self) -> bool:
        return "HEARTBEAT" in self.latest and bool(self.latest["HEARTBEAT"].base_mode & 128)

    @property
    def mode(self) -> str:
        """Name the vehicle's mode, if it is one of the few that a test knows."""
        custom = self.latest["HEARTBEAT"].custom_mode
        if self.vehicle.autopilot == "px4":
            pair = custom >> 16 & 0xFF, custom >> 24
            return next((name for name, mode in PX4_MODES.items() if mode == pair), f"{pair}")
        return next((name for name, mode in COPTER_MODES.items() if mode == custom), f"{custom}")

    def stands_ready(self) -> float:
        """Wait on the ground until it would arm and knows where it is."""
        self.waits(lambda: "HEARTBEAT" in self.latest, "a heartbeat", READY_S)
        for message in ("SYS_STATUS", "LOCAL_POSITION_NED", "EXTENDED_SYS_STATE"):
            self.wants(message, 10.0)
        self.chooses("AUTO.LOITER" if self.vehicle.autopilot == "px4" else "STABILIZE")
        for message in ("SYS_STATUS", "LOCAL_POSITION_NED"):
            self.latest.pop(message, None)
        return self.waits(lambda: self._is_ready, "ready to arm", READY_S)

    @property
    def _is_ready(self) -> bool:
        status = self.latest.get("SYS_STATUS")
        return (
            status is not None
            and bool(status.onboard_control_sensors_health & PREARM_CHECK)
            and "LOCAL_POSITION_NED" in self.latest
        )

    # What is said.

    def command(self, number: int, *values: float, compid: int = 1) -> None:
        sysid = self.vehicle.sysid
        padded = [*values, *[0.0] * (7 - len(values))]
        self.send(mavlink.MAVLink_command_long_message(sysid, compid, number, 0, *padded))

    def orders(self, number: int, *values: float) -> int:
        """Order the vehicle's controller; give the result."""
        return self.asks(number, *values, compid=COMPANION)

    def asks(self, number: int, *values: float, compid: int = 1) -> int:
        """Give a command until it is answered; give the result."""
        self.acks.clear()

        def answer() -> Any:
            return next((ack for ack in self.acks if ack[:2] == (compid, number)), None)

        for _ in range(5):
            self.command(number, *values, compid=compid)
            with contextlib.suppress(AssertionError):
                self.waits(answer, f"an answer to {number}", 2.0)
                return int(answer()[2])
        raise AssertionError(f"command {number} to component {compid} is never answered")

    def chooses(self, mode: str) -> None:
        """Switch the vehicle's mode, as a pilot's switch does."""
        if self.vehicle.autopilot == "px4":
            self.asks(176, 1, *PX4_MODES[mode])
        else:
            self.asks(176, 1, COPTER_MODES[mode])

    def lands(self, within_s: float) -> bool:
        """Bring the vehicle down if it is in the air; False when it does not come."""
        with contextlib.suppress(AssertionError):
            if self.is_armed:
                self.chooses("AUTO.LAND" if self.vehicle.autopilot == "px4" else "LAND")
            self.waits(lambda: not self.is_armed, "landed", within_s)
            return True
        return False

    def wants(self, message: str, rate_hz: float) -> None:
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{message}")
        self.asks(511, number, 1e6 / rate_hz)

    @contextlib.contextmanager
    def settings(self, wanted: Settings) -> Iterator[None]:
        """Set those parameters that the vehicle knows, for a while."""
        before = {name: value for name in wanted if (value := self.reads(name)) is not None}
        assert before, f"the vehicle knows none of {', '.join(wanted)}"
        for name in before:
            self.sets(name, wanted[name])
        try:
            yield
        finally:
            for name, value in before.items():
                self.sets(name, value)

    def reads(self, name: str) -> float | None:
        """Give a parameter's value; None when the vehicle does not know it."""
        for _ in range(3):
            self.latest.pop("PARAM_VALUE", None)
            request = (self.sysid, 1, name.encode(), -1)
            self.send(mavlink.MAVLink_param_request_read_message(*request))
            with contextlib.suppress(AssertionError):
                self.waits(lambda: self._told(name), name, 1.0)
                return _number(self.latest["PARAM_VALUE"])
        return None

    def sets(self, name: str, value: float) -> None:
        assert self.reads(name) is not None, f"the vehicle does not know {name}"
        kind = self.latest["PARAM_VALUE"].param_type
        is_bytewise = self.vehicle.autopilot == "px4" and kind == INT32
        sent = struct.unpack("<f", struct.pack("<i", int(value)))[0] if is_bytewise else value
        self.send(mavlink.MAVLink_param_set_message(self.sysid, 1, name.encode(), sent, kind))
        self.waits(
            lambda: math.isclose(self.reads(name) or 0.0, value, abs_tol=1e-3),
            f"{name} set to {value}",
        )

    def send(self, message: Any) -> None:
        if self._address is not None:
            with contextlib.suppress(OSError):
                self._write(message.pack(self._codec))

    def _write(self, data: bytes) -> None:
        if self.vehicle.autopilot == "px4":
            self.vehicle.station.send(data)
        else:
            self.vehicle.station.sendto(data, self._address)

    # How it lives.

    def _live(self) -> None:
        beat_s = sticks_s = 0.0
        while not self._ends.is_set():
            self._listen()
            now = time.monotonic()
            if now >= beat_s:
                beat_s = now + BEAT_S
                self._beat()
            if self.holds_sticks and now >= sticks_s:
                sticks_s = now + STICKS_S
                self._hold_sticks()

    def _listen(self) -> None:
        try:
            data, address = self.vehicle.station.recvfrom(4096)
        except OSError:  # nothing came, or nobody listens yet
            return
        self._address = self._address or address
        for message in self._codec.parse_buffer(data) or []:
            if message.get_srcSystem() == self.vehicle.sysid:
                self._hear(message)

    def _hear(self, message: Any) -> None:
        kind, compid = message.get_type(), message.get_srcComponent()
        if kind == "COMMAND_ACK":
            self.acks.append((compid, message.command, message.result))
        elif compid == 1:
            self.latest[kind] = message
            if kind == "STATUSTEXT":
                self.texts.append(message.text)

    def _beat(self) -> None:
        """Keep the link open: as a ground station, or as something that no failsafe heeds."""
        kind = mavlink.MAV_TYPE_GCS if self.beats else mavlink.MAV_TYPE_ANTENNA_TRACKER
        self._codec.srcSystem = STATION if self.beats else TRACKER
        self.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3))
        self._codec.srcSystem = STATION

    def _hold_sticks(self) -> None:
        sysid = self.vehicle.sysid
        if self.vehicle.autopilot == "px4":
            self.send(mavlink.MAVLink_manual_control_message(sysid, 0, 0, 500, 0, 0))
        else:
            centred = [1500] * 4 + [0] * 4
            self.send(mavlink.MAVLink_rc_channels_override_message(sysid, 1, *centred))

    def _told(self, name: str) -> bool:
        value = self.latest.get("PARAM_VALUE")
        return value is not None and value.param_id == name


def _number(value: Any) -> float:
    """Read a PARAM_VALUE; PX4 sends whole numbers as the bytes of a float."""
    as_bytes = struct.pack("<f", value.param_value)
    is_px4 = value.param_type == INT32
    return float(struct.unpack("<i", as_bytes)[0]) if is_px4 else float(value.param_value)
