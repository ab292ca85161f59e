"""One mock vehicle of each personality under fire, in virtual time.

Two moods take turns. In the *calm* one nothing that arrives may change the flight: broken frames,
wrong targets, requests with hostile fields, and setpoints that say NaN or infinity. Each vehicle
must hover where it was. In the *wild* one everything may be obeyed (forced disarms, take-offs,
modes, setpoints far away), so a vehicle may end on the ground; it must take off again when asked.
A signed fleet obeys none of it, and hovers in both. After each mood every vehicle must answer, and
hold no more than before.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mutations import NAN, SETPOINT, Dice, Forge

from mock_vehicle.fleet import TICK_S, Fleet
from mock_vehicle.world import load_world
from swarm_ctl import wire
from swarm_ctl.signing import Signer, key_of

WORLD = """
name: range
size_m: [60, 60]
ceiling_m: 40
starts: {grid: {origin_m: [25, 30], spacing_m: 10}}
radio: {radius_m: 200.0}
"""
PERSONALITIES = ("px4", "ardupilot")
BATCH = 50
"""Datagrams per vehicle and tick."""
MOOD_TICKS = 100
"""How long a mood lasts."""
HEIGHT_M = 5.0
STRAYED_M = 0.5
PATIENCE_TICKS = 900
PER_FLIGHT = 100_000
GROWTH = 3000
"""Elements that a vehicle may hold more than after its first take-off."""

COMMAND_LONG = wire.message("COMMAND_LONG")
COMMAND_ACK = wire.message("COMMAND_ACK")
POSITION = 0xDF8
ARM_DISARM, SET_MODE, TAKEOFF, REQUEST_MESSAGE = 400, 176, 22, 512
FORCE, AUTOPILOT_VERSION, ACCEPTED = 21196, 148, 0
KEY, SIGNED_FROM = key_of("range"), 1 << 45
AP_GUIDED, PX4_OFFBOARD = 4, 6


@dataclass
class Report:
    """What was sent, and what came of it."""

    sent: Counter[str] = field(default_factory=Counter)
    """Frames by mutation."""
    heard: int = 0
    """Frames that the vehicles understood."""
    answered: Counter[str] = field(default_factory=Counter)
    """Results of commands, as "personality result"."""
    flights: int = 0
    """Take-offs, on the ground at first and wherever a wild mood has ended afterwards."""
    strayed_m: float = 0.0
    """Farthest from where a calm vehicle hovered."""
    handling_s: float = 0.0
    """CPU time of receiving and answering."""
    total_s: float = 0.0
    """CPU time of all."""

    @property
    def frames(self) -> int:
        """Count the frames sent."""
        return self.sent.total()


def fuzz(frames: int, seed: int) -> Report:
    """Fuzz fresh vehicles before their batteries are empty, some signed; add the reports up."""
    whole = Report()
    while whole.frames < frames:
        signed = whole.flights > 0 and seed % 4 == 0
        part = Range(seed, signed=signed).fuzz(min(PER_FLIGHT, frames - whole.frames))
        seed += 1
        whole.sent += part.sent
        whole.answered += part.answered
        whole.heard += part.heard
        whole.flights += part.flights
        whole.strayed_m = max(whole.strayed_m, part.strayed_m)
        whole.handling_s += part.handling_s
        whole.total_s += part.total_s
    return whole


class Range:
    """Where the vehicles are fuzzed, in virtual time."""

    def __init__(self, seed: int, *, signed: bool = False) -> None:
        with tempfile.TemporaryDirectory() as scratch:
            file = Path(scratch) / "range.yaml"
            file.write_text(WORLD, encoding="utf-8")
            world = load_world(file)
        self.fleet = Fleet(world, PERSONALITIES, seed=seed, first_sysid=7)
        self.forges = [Forge(v, Dice(seed + v.index)) for v in self.fleet.vehicles]
        self._signer = Signer(KEY, SIGNED_FROM) if signed else None
        if signed:
            self.fleet.sign_with(KEY, SIGNED_FROM)
        self._captured: dict[int, bytes] = {}
        """The first signed command that each vehicle obeyed, a forced disarm."""
        self.report = Report()
        self.now = 0.0
        self._ticks = 0
        self._held: list[int] = []
        self._parser = wire.Parser([COMMAND_ACK])

    def fuzz(self, frames: int) -> Report:
        """Send at least so many mutated frames, calm and wild in turn."""
        began = time.process_time()
        for forge in self.forges:
            self._take_off(forge)
        self._held = [held(vehicle) for vehicle in self.fleet.vehicles]
        while self.report.frames < frames:
            self._mood(calm=True)
            self._mood(calm=False)
            self._check_growth()
            for forge in self.forges:
                self._take_off(forge)
        self.report.heard = sum(vehicle.received for vehicle in self.fleet.vehicles)
        self.report.total_s = time.process_time() - began
        return self.report

    def _mood(self, *, calm: bool) -> None:
        hovers = calm or self._signer is not None
        for forge in self.forges:
            forge.calm = calm
            forge.hovers = hovers
        for _ in range(MOOD_TICKS):
            for forge in self.forges:
                self._throw(forge)
            self._tick()
            if hovers:
                self._check_hover()
        for forge in self.forges:
            self._check_answer(forge)

    def _throw(self, forge: Forge) -> None:
        """Send a batch; making it is not the vehicle's time."""
        datagrams: list[bytes] = []
        if self._signer is not None:
            self.report.sent["replayed command"] += 1
            datagrams.append(self._captured[forge.vehicle.index])
        for _ in range(BATCH):
            kind, several = forge.make()
            self.report.sent[kind] += 3 if kind == "several in a datagram" else 1
            datagrams += several
        links = range(forge.vehicle.links)
        began = time.process_time()
        for data in datagrams:
            self.fleet.receive(forge.vehicle.index, data, self.now, forge.dice.pick(links))
        self.report.handling_s += time.process_time() - began

    def _tick(self) -> bytes:
        """Let a tenth of a second pass; give all that the vehicles said."""
        self._ticks += 1
        self.now = self._ticks * TICK_S
        began = time.process_time()
        said = b""
        for left in reversed(range(round(TICK_S / self.fleet.step_s))):
            leaving = self.fleet.step(self.now - left * self.fleet.step_s)
            said += b"".join(data for _, data in leaving)
        self.report.handling_s += time.process_time() - began
        body = self.fleet.dynamics
        for motion in (body.position_ned_m, body.velocity_ned_m_s, body.yaw_rad):
            assert np.isfinite(motion).all(), "a vehicle is nowhere"
        for forge in self.forges:
            if forge.hovers:
                self._hold(forge)
        assert all(vehicle.alive for vehicle in self.fleet.vehicles), "a battery is empty"
        return said

    # Flying.

    def _send(self, forge: Forge, frame: bytes) -> bytes:
        """Send as the one who has the key, if there is one; give what was sent."""
        if self._signer is not None:
            self._signer.advance(self.now)
            frame = self._signer.sign(frame)
        self.fleet.receive(forge.vehicle.index, frame, self.now)
        return frame

    def _command(self, forge: Forge, number: int, *params: float) -> int:
        """Give a command until it is acknowledged: a cut frame may have swallowed its beginning."""
        sysid = forge.vehicle.sysid
        seven = (*params, *(0.0,) * 7)[:7]
        for seq in range(3):
            frame = COMMAND_LONG.pack(seq, 200, 190, sysid, 1, number, 0, *seven)
            self._captured.setdefault(forge.vehicle.index, self._send(forge, frame))
            for heard in self._parser.feed(self._tick()):
                ack = heard.values
                if (heard.sysid, ack.command, ack.target_system) == (sysid, number, 200):
                    return int(ack.result)
        raise AssertionError(f"{forge.vehicle.personality} answers {number} no more")

    def _hold(self, forge: Forge) -> None:
        """Keep PX4's OFFBOARD alive; whatever follows until the next tick is flown instead."""
        values = (*forge.hover_ned_m, *(0.0,) * 8)
        frame = SETPOINT.pack(0, 200, 190, 0, forge.vehicle.sysid, 1, 1, POSITION, *values)
        self._send(forge, frame)

    def _wait(self, what: str, is_done: Callable[[], bool], each: Callable[[], None]) -> None:
        for _ in range(PATIENCE_TICKS):
            if is_done():
                return
            each()
            self._tick()
        raise AssertionError(f"in vain: {what}")

    def _take_off(self, forge: Forge) -> None:
        """Bring a vehicle down by force, whatever it does, and let it climb and hover again.

        Its parameters are the default ones again: with others it may rightly not fly.
        """
        vehicle = forge.vehicle
        name, index = vehicle.personality, vehicle.index
        body = self.fleet.dynamics
        forge.hovers = False
        for parameter, default in vehicle.autopilot.parameters.changed.items():
            vehicle.autopilot.set_parameter(parameter, default)
        assert self._command(forge, ARM_DISARM, 0.0, FORCE) == ACCEPTED
        self._wait(f"{name} comes down", lambda: bool(body.on_ground[index]), lambda: None)
        self._wait(f"{name} is ready", lambda: vehicle.autopilot.is_ready(self.now), lambda: None)
        for _ in range(20):
            self._tick()
        if name == "px4":
            altitude_m = vehicle.autopilot.origin.amsl_m + HEIGHT_M
            assert self._command(forge, TAKEOFF, *(NAN,) * 6, altitude_m) == ACCEPTED
            assert self._command(forge, ARM_DISARM, 1.0) == ACCEPTED
        else:
            assert self._command(forge, SET_MODE, 1.0, AP_GUIDED) == ACCEPTED
            assert self._command(forge, ARM_DISARM, 1.0) == ACCEPTED
            assert self._command(forge, TAKEOFF, *(0.0,) * 6, HEIGHT_M) == ACCEPTED
        self._wait(f"{name} climbs", lambda: body.position_ned_m[index, 2] < -4.7, lambda: None)
        forge.hover_ned_m = (*vehicle.autopilot.state[:2], -HEIGHT_M)
        forge.hovers = True
        for _ in range(30):
            self._tick()
        if name == "px4":
            assert self._command(forge, SET_MODE, 1.0, PX4_OFFBOARD) == ACCEPTED
        self.report.flights += 1

    # Checks.

    def _check_hover(self) -> None:
        for forge in self.forges:
            vehicle = forge.vehicle
            here = vehicle.autopilot.state[:3]
            strayed_m = math.dist(here, forge.hover_ned_m)
            self.report.strayed_m = max(self.report.strayed_m, strayed_m)
            assert vehicle.flying, f"{vehicle.personality} flies no more"
            assert strayed_m < STRAYED_M, f"{vehicle.personality} strayed by {strayed_m} m"

    def _check_answer(self, forge: Forge) -> None:
        result = self._command(forge, REQUEST_MESSAGE, AUTOPILOT_VERSION)
        assert result == ACCEPTED
        self.report.answered[f"{forge.vehicle.personality} {result}"] += 1

    def _check_growth(self) -> None:
        for vehicle, before in zip(self.fleet.vehicles, self._held, strict=True):
            growth = held(vehicle) - before
            assert growth < GROWTH, f"{vehicle.personality} holds {growth} elements more"


def held(root: object) -> int:
    """Count the elements of all containers that an object holds; a bounded deque counts full."""
    total, seen, pending = 0, set(), [root]
    while pending:
        one = pending.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, dict):
            total += len(one)
            pending += one.values()
        elif isinstance(one, deque):
            total += one.maxlen or len(one)
        elif isinstance(one, list | tuple | set | frozenset):
            total += len(one)
            pending += one
        elif isinstance(one, bytes):
            total += len(one)
        elif type(one).__module__.startswith(("mock_vehicle", "swarm_ctl")):
            pending += getattr(one, "__dict__", {}).values()
            pending += [getattr(one, name) for name in getattr(type(one), "__slots__", ())]
    return total
