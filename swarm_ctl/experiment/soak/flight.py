"""One scenario flown in virtual time, with every promise looked at after every tick."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from swarm_ctl import wire
from swarm_ctl.agent.phases import Phase
from swarm_ctl.experiment.arena import STEPS_PER_TICK, Arena
from swarm_ctl.experiment.soak.invariants import EVERY_TICK, IN_THE_END, Check
from swarm_ctl.experiment.soak.look import Look, Witness
from swarm_ctl.experiment.soak.scenario import Scenario
from swarm_ctl.experiment.source import code_hash
from swarm_ctl.flight import Faults, finish
from swarm_ctl.model import Operator
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.unrecorded import Record

LONGEST_S = 400.0
"""Mission time by which every controller must have ended: `limits.max_time_s`, 90 s for a landing,
60 s for a link that is given up, and as much again for what begins late."""
GIVEN_UP_S = 60.0
"""A pilot has brought his vehicle down by then, or nobody will."""
PILOT_S, PILOT_AGAIN_S = 8.0, 3.0
"""After so long the pilot of a vehicle that yielded brings it down; he says so again and again."""
FALLS_S = 3.0
"""Who is disarmed in the air, as by a reboot, counts as landed, and is down after so long."""
MODES = {
    "px4": {"hold": (4.0, 3.0), "land": (4.0, 6.0)},
    "ardupilot": {"hold": (5.0, 0.0), "land": (9.0, 0.0)},
}
_COMMAND_LONG = wire.message("COMMAND_LONG")
_SET_MODE, _STATION = 176, (255, 190)


@dataclass(frozen=True, slots=True)
class Violation:
    """A promise that was broken."""

    invariant: str
    """Name of the check."""
    time_s: float
    """Mission time."""
    words: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a flight."""

    seed: int
    vehicles: int
    time_s: float
    """Mission time flown, s."""
    closest_m: float | None
    """The closest approach of two vehicles that may not touch; none where no two met."""
    cpu_s: float
    run_sha256: str
    """Hash of all frames; empty when none was asked for."""
    code: str
    """Which code flew, see `code_hash`."""
    violation: Violation | None = None

    def keys(self) -> dict[str, Any]:
        """Give it ready for JSON."""
        return asdict(self)


class Script:
    """Operators and pilots, who act at their times."""

    def __init__(self, scenario: Scenario, arena: Arena) -> None:
        self._arena = arena
        self.taken_s: dict[int, float] = {}
        """Whose pilot has chosen another mode in flight, by index, and when he did so first."""
        self.given_s: dict[int, float] = {}
        """Whose pilot has given it back, and when."""
        self._acts = sorted(
            [(order.time_s, order.sysid, order.operator) for order in scenario.orders]
            + [(taken.time_s, taken.sysid, taken.mode) for taken in scenario.takeovers],
            key=lambda act: act[0],
            reverse=True,
        )
        self._pilot_due_s = 0.0

    @property
    def is_over(self) -> bool:
        """Whether nothing will change any more: all have ended, or lie where their pilots are."""
        now = self._arena.now
        agents = [controller.agent for controller in self._arena.controllers]
        return now >= LONGEST_S or all(
            agent.is_ended or (agent.phase is Phase.YIELDED and now - agent.entered_s > GIVEN_UP_S)
            for agent in agents
        )

    def play(self) -> None:
        """Do what is due."""
        now = self._arena.now
        while self._acts and self._acts[-1][0] <= now:
            _, sysid, act = self._acts.pop()
            for index, controller in enumerate(self._arena.controllers):
                if sysid not in {None, index + 1}:
                    continue
                if isinstance(act, Operator):
                    if self.taken_s.pop(index, None) is not None:
                        self.given_s[index] = now
                    controller.order(act, now)
                else:
                    self._choose(index, act)
        if now >= self._pilot_due_s:
            self._pilot_due_s = now + PILOT_AGAIN_S
            self._bring_down()

    def _bring_down(self) -> None:
        """Let the pilots of vehicles that yielded a while ago land them."""
        for index, controller in enumerate(self._arena.controllers):
            agent = controller.agent
            if agent.phase is Phase.YIELDED and agent.now - agent.entered_s > PILOT_S:
                self._choose(index, "land")

    def _choose(self, index: int, mode: str) -> None:
        """Choose a mode from a ground station."""
        vehicle = self._arena.fleet.vehicles[index]
        if vehicle.flying and vehicle.alive:
            self.taken_s.setdefault(index, self._arena.now)
        numbers = (1.0, *MODES[vehicle.personality][mode], 0.0, 0.0, 0.0, 0.0)
        frame = _COMMAND_LONG.pack(0, *_STATION, vehicle.sysid, 1, _SET_MODE, 0, *numbers)
        self._arena.fleet.receive(index, frame, self._arena.now)


def arena_of(scenario: Scenario, record: Record) -> Arena:
    """Put the vehicles of a scenario into its world."""
    faults = Faults.parse(scenario.faults, scenario.mission.vehicles)
    world = scenario.build_world(Path(f"soak-{scenario.seed}.json"))
    return Arena(scenario.mission, record, faults, world)


def fly(scenario: Scenario, *, hashed: bool = False) -> Outcome:
    """Fly to the end, or to the first broken promise."""
    began = time.process_time()
    witness = Witness(hashed=hashed)
    arena = arena_of(scenario, witness)
    script = Script(scenario, arena)
    look = Look(scenario, arena, witness)
    look.taken_s, look.given_s = script.taken_s, script.given_s
    violation = _watch(look, script)
    return Outcome(
        scenario.seed,
        scenario.mission.vehicles,
        round(arena.now, 2),
        round(look.closest_m, 3) if look.closest_m < float("inf") else None,
        round(time.process_time() - began, 3),
        witness.hexdigest(),
        code_hash(),
        violation,
    )


def fly_recorded(scenario: Scenario, path: Path, *, until_s: float) -> None:
    """Fly it again up to a moment, unwatched, and leave a whole run folder."""
    mission, began = scenario.mission, time.monotonic()
    folder = RunFolder.create(path, mission.name, mission.dump(), seed=mission.seed, mode="virtual")
    (folder.path / "scenario.json").write_text(scenario.text(), encoding="utf-8")
    arena = arena_of(scenario, folder)
    script = Script(scenario, arena)
    arena.fly(lambda _: script.play(), until_s=until_s)
    arena.write_truth(folder.path)
    finish(
        mission,
        folder,
        arena.controllers,
        mode="virtual",
        time_s=arena.now,
        wall_s=time.monotonic() - began,
        interrupted=not arena.is_over,
        notes=arena.notes,
    )


def _watch(look: Look, script: Script) -> Violation | None:
    arena, found = look.arena, None
    try:
        while found is None and not arena.is_over and not script.is_over:
            for _ in range(STEPS_PER_TICK):
                arena.step()
            script.play()
            look.advance()
            found = _judge(EVERY_TICK, look)
        over_s = arena.now + FALLS_S
        while found is None and arena.now < over_s and any(look.falling):
            arena.step()
            look.advance()
    except Exception as error:  # noqa: BLE001 - that nothing raises is a promise, too
        at = traceback.extract_tb(error.__traceback__)[-1]
        words = f"{type(error).__name__}: {error} ({Path(at.filename).name}:{at.lineno})"
        return Violation("nothing_raises", round(look.arena.now, 2), words)
    return found or _judge(IN_THE_END, look)


def _judge(checks: Sequence[Check], look: Look) -> Violation | None:
    for check in checks:
        if words := check(look):
            return Violation(check.__name__, round(look.now, 2), words)
    return None
