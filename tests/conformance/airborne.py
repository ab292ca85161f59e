"""A controller in the air, made to believe it by the telemetry of no vehicle at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from halls import MISSION, write_hall

from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.phases import Phase
from swarm_ctl.autopilot import command as commands
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.base import COMPANION_COMPONENT, Autopilot
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.flight import orders_of
from swarm_ctl.mission import load_mission

PILOTS = {pilot.name: pilot for pilot in (PX4, ARDUPILOT)}
EXPLORES = {Phase.EXPLORING, Phase.AVOIDING}
TICK_S = 0.1
HEIGHT_M = MISSION["flight"]["height_m"]
READY = 0x10000000
GOOD_ESTIMATE = 831
SETPOINT, COMMAND = "SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG"


def agent_of(folder: Path, **flight: Any) -> Agent:
    """Give a controller for vehicle 1 of the hall mission, in open air."""
    flight = {**MISSION["flight"], "open_air": True, **flight}
    mission = load_mission(write_hall(folder, {"flight": flight, "duration_s": 500.0}, None))
    return Agent(
        1,
        orders_of(mission),
    )


def packed(name: str, number: int, /, **fields: Any) -> bytes:
    """Make a frame of vehicle 1's autopilot; what is not given is zero."""
    message = wire.message(name)
    values: Any = message.unpack(b"")._replace(**fields)
    return message.pack(number & 0xFF, 1, 1, *values)


class Airborne:
    """A controller that explores, and the voice of its autopilot."""

    def __init__(self, folder: Path, pilot: Autopilot) -> None:
        self.pilot = pilot
        self.agent = agent_of(folder)
        self.now = 0.0
        self.sent: list[tuple[float, str]] = []
        """What the controller wanted, setpoints and commands by name, and when."""
        self.is_told_where = True
        self._said = 0
        self._parser = wire.Parser([SETPOINT, COMMAND])
        self._take_off()

    def say(self, name: str, /, **fields: Any) -> None:
        """Let the autopilot say something now."""
        self._said += 1
        self.agent.receive(packed(name, self._said, **fields), self.now)

    def beat(self, *, armed: bool = True) -> None:
        """Let the autopilot say that it obeys."""
        base = 128 * armed + 1
        fields = {"type": 2, "autopilot": self.pilot.heartbeat_id, "mavlink_version": 3}
        mode = self.pilot.offboard_mode
        self.say("HEARTBEAT", base_mode=base, custom_mode=mode, system_status=4, **fields)

    def tick(self, height_m: float = HEIGHT_M) -> None:
        """Let time pass, with attitude and place."""
        self.now += TICK_S
        boot_ms = round(self.now * 1e3)
        self.say("ATTITUDE", time_boot_ms=boot_ms)
        if self.is_told_where:
            self.say("LOCAL_POSITION_NED", time_boot_ms=boot_ms, z=-height_m)
        for frame in self._parser.feed(self.agent.tick(self.now)):
            if wire.message(frame.id).name == SETPOINT:
                self.sent.append((self.now, SETPOINT))
            else:
                self.sent.append((self.now, commands.COMMAND_NAMES[frame.values.command]))
                self._accept(frame.values.command)

    def _accept(self, number: int) -> None:
        whom = {"target_system": 1, "target_component": COMPANION_COMPONENT}
        self.say("COMMAND_ACK", command=number, **whom)

    def sent_since(self, since_s: float) -> set[str]:
        """Name what the controller has wanted since then."""
        return {name for at_s, name in self.sent if at_s > since_s}

    def _take_off(self) -> None:
        ready = {"onboard_control_sensors_present": READY, "onboard_control_sensors_health": READY}
        estimator = "ESTIMATOR_STATUS" if self.pilot is PX4 else "EKF_STATUS_REPORT"
        while self.agent.phase not in EXPLORES:
            assert self.now < 30.0, self.agent.reason
            flies = self.agent.phase in {Phase.TAKEOFF, *EXPLORES}
            if round(self.now / TICK_S) % 10 == 0:
                self.beat(armed=flies or self.agent.phase is Phase.ARMING)
                self.say("SYS_STATUS", battery_remaining=90, **ready)
                self.say(estimator, flags=GOOD_ESTIMATE)
            self.tick(HEIGHT_M if flies else 0.0)
