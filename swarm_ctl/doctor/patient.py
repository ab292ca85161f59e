"""One autopilot under examination: what is asked of it, when, and what becomes of the answers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from swarm_ctl import wire
from swarm_ctl.autopilot.base import AUTOPILOT_COMPONENT, COMPANION_COMPONENT
from swarm_ctl.autopilot.command import (
    REQUEST_MESSAGE,
    RUN_PREARM_CHECKS,
    SET_MESSAGE_INTERVAL,
    CommandQueue,
    command,
)
from swarm_ctl.autopilot.telemetry import SCAN_HZ
from swarm_ctl.doctor import ardupilot, px4
from swarm_ctl.doctor.chart import Chart
from swarm_ctl.doctor.parameters import Parameters
from swarm_ctl.doctor.rows import Parameter
from swarm_ctl.signing import Gatekeeper

COMPANION, NO_AUTOPILOT, STATE_ACTIVE, MAVLINK_VERSION = 18, 8, 4, 3
BEAT = (COMPANION, NO_AUTOPILOT, 0, 0, STATE_ACTIVE, MAVLINK_VERSION)
"""HEARTBEAT of a companion; never a ground station's, whose loss is an autopilot's business."""
MEASURED_S = 4.0
WATCHED_S = 2.0
"""How long an armed vehicle is listened to."""
HEARTBEAT_S = 1.0
PING_S = 0.2
TOO_LONG_S = 15.0
"""An examination that is not over by now is."""
TABLES: Mapping[str, tuple[Parameter, ...]] = {
    "px4": px4.PARAMETERS,
    "ardupilot": ardupilot.PARAMETERS,
}
EXTRA_HZ = {"GPS_RAW_INT": 1.0}
"""What only an examination needs."""
_TIMESYNC, _HEARTBEAT = wire.message("TIMESYNC"), wire.message("HEARTBEAT")
_COMMAND_LONG, _PARAM_VALUE = wire.message("COMMAND_LONG"), wire.message("PARAM_VALUE")


class Patient:
    """Examine one autopilot; one that is armed is listened to and not spoken to."""

    def __init__(self, sysid: int, place: str, gate: Gatekeeper, now: float) -> None:
        self.chart = Chart(sysid, place)
        self.parameters: Parameters | None = None
        """None until it is known how it speaks of them."""
        self.changed: dict[str, tuple[float, float]] = {}
        """What was set, and is in force by its own word: old value, new value."""
        self.refused: dict[str, float] = {}
        """What was set and is not in force."""
        self._wanted: dict[str, tuple[float, float]] = {}
        self._gate = gate
        self._commands = CommandQueue(retry_s=0.4, attempts=4)
        self._began_s = now
        self._end_s = now + TOO_LONG_S
        self._measuring_s: float | None = None
        self._measured = False
        self._seq = 0
        self._next_heartbeat_s = now
        self._next_ping_s = now
        self._pings: set[int] = set()

    @property
    def table(self) -> tuple[Parameter, ...]:
        """The parameters that would bite this autopilot."""
        autopilot = self.chart.autopilot
        return TABLES[autopilot.name] if autopilot else ()

    def progress(self, now: float) -> float:
        """Say how much of it is done, 0 to 1."""
        if self.is_examined(now):
            return 1.0
        begun_s = self._measuring_s if self._measuring_s is not None else now
        return min((now - begun_s + 0.5) / (MEASURED_S + 1.0), 0.95)

    def is_examined(self, now: float) -> bool:
        """Whether all is known that can be known."""
        if self.chart.armed or self.chart.autopilot is None:
            return now - self._began_s >= WATCHED_S
        is_read = self.parameters is not None and self.parameters.is_idle
        return (self._measured and is_read) or now >= self._end_s

    def receive(self, frame: wire.Frame, now: float) -> None:
        """Take a frame of this autopilot."""
        chart = self.chart
        chart.receive(frame, now)
        for ack in chart.telemetry.acks:
            chart.is_answering = True
            self._commands.acknowledge(ack, now)
        chart.telemetry.acks.clear()
        if frame.id == _PARAM_VALUE.id and self.parameters is not None:
            chart.is_answering = True
            self.parameters.receive(frame)
        elif frame.id == _TIMESYNC.id and frame.values.ts1 in self._pings:
            self._pings.discard(frame.values.ts1)
            chart.round_trips_s.append(now - frame.values.ts1 * 1e-9)

    def tick(self, now: float) -> Iterator[bytes]:
        """Go on, and give what to send now."""
        if self.chart.armed or self.chart.autopilot is None:
            return
        if self.parameters is None:
            self._begin()
        if now >= self._next_heartbeat_s:
            self._next_heartbeat_s = now + HEARTBEAT_S
            yield self._pack(_HEARTBEAT, *BEAT)
        yield from self._ask(now)
        if self._measuring_s is None and not self._is_asking:
            self._measuring_s = now
            self.chart.is_measuring = True
        elif self.chart.is_measuring:
            yield from self._measure(now)

    def fix(self, values: Mapping[str, float], now: float) -> None:
        """Set parameters, and read them back."""
        self._end_s = now + TOO_LONG_S
        assert self.parameters is not None  # noqa: S101 - only what was read is fixed
        for name, value in values.items():
            self._wanted[name] = self.parameters.values[name], value
        self.parameters.set(values)
        self.parameters.read(values)

    def check_fixed(self) -> None:
        """Compare what was read back with what was set."""
        known = self.parameters.values if self.parameters else {}
        for name, (old, new) in self._wanted.items():
            if abs(known.get(name, float("nan")) - new) <= 1e-5 * max(abs(new), 1.0):
                self.changed[name] = old, new
            else:
                self.refused[name] = new
                known.setdefault(name, old)  # nobody said otherwise
        self._wanted = {}

    def _begin(self) -> None:
        streams_hz = self.chart.autopilot.streams_hz if self.chart.autopilot else {}
        self._commands.request(command(REQUEST_MESSAGE, wire.message("AUTOPILOT_VERSION").id))
        for stream, hz in {**streams_hz, **SCAN_HZ, **EXTRA_HZ}.items():
            number = wire.message(stream).id
            self._commands.request(command(SET_MESSAGE_INTERVAL, number, 1e6 / hz))
        self._commands.request(command(RUN_PREARM_CHECKS))
        self.parameters = Parameters(is_bytewise=self.chart.is_px4)
        self.parameters.read(sorted({name for row in self.table for name in row.reads}))

    @property
    def _is_asking(self) -> bool:
        return self._commands.is_waiting(SET_MESSAGE_INTERVAL)

    def _ask(self, now: float) -> Iterator[bytes]:
        wanted, timed_out = self._commands.poll(now)
        if timed_out is not None and not self.chart.is_answering:
            self._give_up()
            return
        target = (self.chart.sysid, AUTOPILOT_COMPONENT)
        if wanted is not None:
            asked, confirmation = wanted
            yield self._pack(_COMMAND_LONG, *target, asked.id, confirmation, *asked.parameters)
        if self.parameters is not None:
            for message, values in self.parameters.poll(now):
                yield self._pack(message, *target, *values)

    def _give_up(self) -> None:
        """Only listen to one who does not answer."""
        self._commands = CommandQueue()
        if self.parameters is not None:
            self.parameters.give_up()

    def _measure(self, now: float) -> Iterator[bytes]:
        self.chart.measured_s = now - (self._measuring_s or now)
        if self.chart.measured_s >= MEASURED_S:
            self.chart.is_measuring, self._measured = False, True
            self.chart.reasons = self.chart.telemetry.why_not(now)
        elif now >= self._next_ping_s:
            self._next_ping_s = now + PING_S
            stamp = int(now * 1e9)
            self._pings.add(stamp)
            yield self._pack(_TIMESYNC, 0, stamp)

    def _pack(self, message: wire.Message, *values: object) -> bytes:
        frame = message.pack(self._seq & 0xFF, self.chart.sysid, COMPANION_COMPONENT, *values)
        self._seq += 1
        return self._gate.seal(frame)
