"""What an autopilot tells of itself: its mode, its health, its words; with the time of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from swarm_ctl import wire
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.base import ARMED_FLAG, COMPANION_COMPONENT, Autopilot
from swarm_ctl.autopilot.command import Ack
from swarm_ctl.autopilot.complaints import PREARM_CHECK, Complaints, unhealthy
from swarm_ctl.autopilot.events import Events
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.autopilot.streams import Streams
from swarm_ctl.autopilot.texts import Text, Texts

STANDBY, ACTIVE, CRITICAL, EMERGENCY, TERMINATED = 3, 4, 5, 6, 8
GOOD_ESTIMATE = 1 | 2 | 4 | 8
"""Flags of both estimators: attitude, velocity level and vertical, position from the start.

ArduPilot flies with 831; when GNSS is gone it tells 37, then 167. PX4 flies with 831 or 895."""
INTENT_S = 2.0
"""How old word of the chosen mode may be when a mode is told; PX4 gives it twice a second."""

AUTOPILOTS: dict[int, Autopilot] = {pilot.heartbeat_id: pilot for pilot in (PX4, ARDUPILOT)}
MOST_NEWS = 256
"""What waits to be taken note of, of a kind: when a link that hung lets go, the latest count."""
Handler = Callable[[Any, float], None]
"""Takes a message's values, and when they came."""


class Status:
    """Latest word of one autopilot on itself; times are mission time, -inf for never."""

    def __init__(self, sysid: int) -> None:
        self.sysid = sysid
        self.streams = Streams()
        self.autopilot: Autopilot | None = None
        self.heartbeat_s = -math.inf
        self.mode_s = -math.inf
        """When the mode was told last, by HEARTBEAT or CURRENT_MODE."""
        self.mode_changed_s = -math.inf
        """When another mode was told; until the next heartbeat, `armed` may be older."""
        self.armed, self.custom_mode = False, -1
        self.intended_mode = -1
        """What its user chose, as PX4 tells it; a failsafe flies another mode meanwhile."""
        self.intended_s = -math.inf
        self.system_status = 0
        self.prearm_ok: bool | None = None
        """Whether the checks before arming pass; None when it does not tell."""
        self.unhealthy: list[str] = []
        """The sensors in use that are not healthy."""
        self.estimate_ok: bool | None = None
        """Whether the estimator trusts its position; None when it does not tell."""
        self.estimate_s = -math.inf
        self.battery_fraction: float | None = None
        self.texts: list[Text] = []
        """What it said since the agent looked last."""
        self.acks: list[Ack] = []
        self.events = Events()
        self._chunks = Texts()
        self._complaints = Complaints()
        self._handlers: dict[int, Handler] = {}
        self._listen(
            {
                "HEARTBEAT": self._heartbeat,
                "CURRENT_MODE": self._current_mode,
                "SYS_STATUS": self._sys_status,
                "BATTERY_STATUS": self._battery_status,
                "ESTIMATOR_STATUS": self._estimate,
                "EKF_STATUS_REPORT": self._estimate,
                "COMMAND_ACK": self._ack,
                "STATUSTEXT": self._text,
                "EVENT": self._event,
            }
        )

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
    def may_resume(self) -> bool:
        """Whether its failsafe gives the mode back by itself once setpoints come again."""
        pilot, is_final = self.autopilot, self.system_status == TERMINATED
        resumes = pilot is not None and pilot.resumes_from_failsafe
        return self.is_failsafe and resumes and not is_final

    @property
    def mode_name(self) -> str:
        """Name the mode the autopilot is in."""
        return self.autopilot.mode_name(self.custom_mode) if self.autopilot else "unknown"

    def why_not(self, now: float) -> str:
        """Say what the vehicle itself has against flying, in words; empty when nothing."""
        for text in self._chunks.overdue(now):
            self._say(text, now)
        reasons = [*self.events.barriers, *self._complaints.recent(now), *self.unhealthy]
        return "; ".join(dict.fromkeys(reasons))

    def _listen(self, handlers: dict[str, Handler]) -> None:
        """Take messages by name."""
        self._handlers |= {wire.message(name).id: handler for name, handler in handlers.items()}

    def _heartbeat(self, values: Any, now: float) -> None:
        self.heartbeat_s = now
        pilot = AUTOPILOTS.get(values.autopilot)
        if pilot is not None and pilot is not self.autopilot:
            self.autopilot = pilot
            self.streams.want(pilot.streams_hz)
        self.armed = bool(values.base_mode & ARMED_FLAG)
        self._mode(values.custom_mode, now)
        self.system_status = values.system_status

    def _current_mode(self, values: Any, now: float) -> None:
        self.intended_s, self.intended_mode = now, values.intended_custom_mode
        self._mode(values.custom_mode, now)

    def _mode(self, custom_mode: int, now: float) -> None:
        self.mode_s = now
        if custom_mode != self.custom_mode:
            self.custom_mode, self.mode_changed_s = custom_mode, now

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

    def _ack(self, values: Any, _now: float) -> None:
        """Take what answers us; in MAVLink 1, and from old firmware, nobody is addressed."""
        for_us = values.target_system in {0, self.sysid}
        if for_us and values.target_component in {0, COMPANION_COMPONENT}:
            self.acks.append(Ack(values.command, values.result, values.progress))
            del self.acks[:-MOST_NEWS]

    def _text(self, values: Any, now: float) -> None:
        for text in self._chunks.hear(values, now):
            self._say(text, now)

    def _event(self, values: Any, now: float) -> None:
        text = self.events.hear(values)
        if text is not None:
            self._say(text, now)

    def _say(self, text: Text, now: float) -> None:
        self.texts.append(text)
        del self.texts[:-MOST_NEWS]
        self._complaints.hear(text, now)
