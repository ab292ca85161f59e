"""Kill the controllers of ten flying vehicles at random moments, and see what becomes of them.

A mock fleet and `swarm-ctl fly` are processes; SIGKILL hits the latter, which is started again at
once, as a service manager does. The referee says who hit or left what, the files what was lost.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from swarm_ctl.record.flight_journal import read_flight_journal
from swarm_ctl.record.resume import journals_in

MISSION = Path(__file__).parent.parent / "missions" / "open_3d.yaml"
FENCE_M = 14.0
"""Half of the hall is out of bounds for most: a fence that matters."""
OVERSHOOT_M = 0.5
"""What the failsafe takes for inside as well."""
POLL_S = 0.02
IN_FLIGHT = {"takeoff", "exploring", "holding", "returning"}


@dataclass(frozen=True, slots=True)
class Kill:
    """One kill and what followed."""

    moment_s: float
    """Since the first vehicle took off, by the clock."""
    phases: dict[str, int]
    taken_over_s: float | None
    """Until the journals of all that flew grew again; None when the next kill came first."""
    lines: int
    """In the journals of all, after the kill."""
    is_intact: bool
    """Whether every line was whole, and all that had been there before still was."""


class Session:
    """The mock fleet, and who flies it."""

    def __init__(self, folder: Path, vehicles: int, duration_s: float, seed: int) -> None:
        self.folder, self.out = folder, folder / "run"
        self._vehicles = vehicles
        mission = yaml.safe_load(MISSION.read_text("utf-8"))
        world = MISSION.parent / mission["world"]
        mission |= {"world": str(world), "duration_s": duration_s, "seed": seed}
        mission["limits"]["radius_m"] = FENCE_M
        self.limits = mission["limits"]
        self._mission = folder / "crash.yaml"
        self._mission.write_text(yaml.safe_dump(mission), "utf-8")
        arguments = ("--vehicles", vehicles, "--autopilot", "mixed", "--seed", seed, "--port", 0)
        words = [str(world), *map(str, arguments), "--rates", "lean", "--json"]
        said = folder / "mock.jsonl"  # not a pipe, which would fill up
        with said.open("w") as out:
            self._mock = subprocess.Popen(  # noqa: S603 - ourselves
                [sys.executable, "-m", "mock_vehicle", *words, "--out", str(folder / "truth")],
                stdin=subprocess.PIPE,
                stdout=out,
            )
        while "\n" not in said.read_text():
            time.sleep(POLL_S)  # noqa: TID251 - another process is watched
        ports = json.loads(said.read_text().splitlines()[0])["ready"]["ports"]
        self._urls = [f"udpout://127.0.0.1:{port}" for port in ports]
        self._known: dict[Path, bytes] = {}

    def start(self) -> None:
        """Type the command, for the first time or again."""
        links = [word for url in self._urls for word in ("--connect", url)]
        words = [str(self._mission), *links, "--sysid", "1", "--out", str(self.out)]
        self.log = (self.folder / "said.txt").open("a")
        self.process = subprocess.Popen(  # noqa: S603 - ourselves
            [sys.executable, "-m", "swarm_ctl", "fly", *words],
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=self.log,
            start_new_session=True,
        )

    def kill(self, *, spare_guardian: bool) -> None:
        """Kill the whole process group, and the guardian first if it is not to be spared."""
        if not spare_guardian:
            for pid in guardians_of(self.process.pid):
                os.kill(pid, signal.SIGKILL)
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.log.close()

    def states(self) -> dict[int, dict[str, Any]]:
        """Give the last that each controller has written of everything."""
        states: dict[int, dict[str, Any]] = {}
        for sysid, file in journals_in(self.out).items():
            states[sysid] = {}
            for page in read_flight_journal(file, {"sysid": sysid}).pages:
                states[sysid] |= page
        return states

    def sizes(self) -> dict[int, int]:
        """Give the bytes of each journal."""
        return {sysid: file.stat().st_size for sysid, file in journals_in(self.out).items()}

    def check(self) -> tuple[int, bool]:
        """Count the lines of all journals; tell whether they are whole and nothing was lost."""
        lines, is_intact = 0, True
        for sysid, file in journals_in(self.out).items():
            story = read_flight_journal(file, {"sysid": sysid})
            lines += len(story.pages) + 1
            is_intact &= not story.fault and story.size == file.stat().st_size
        record = [
            *self.out.glob("journals/*"),
            *self.out.glob("tlogs/*"),
            self.out / "events.jsonl",
        ]
        for file in record:
            data = file.read_bytes()
            is_intact &= data.startswith(self._known.get(file, b""))
            self._known[file] = data
        return lines, is_intact

    def truth(self) -> tuple[dict[str, Any], Any]:
        """Stop the mock; give the referee's figures, and tracks (t, vehicle, 3) from the starts."""
        assert self._mock.stdin is not None  # noqa: S101 - opened as a pipe above
        self._mock.stdin.close()
        self._mock.wait()
        with np.load(self.folder / "truth" / "truth.npz") as arrays:
            tracks = arrays["track_ned_m"]
        return json.loads((self.folder / "truth" / "truth.json").read_text()), tracks - tracks[:1]

    def end(self) -> None:
        """Leave nothing running."""
        for process in (self.process, self._mock):
            if process.poll() is None:
                process.kill()
            process.wait()


def guardians_of(pid: int) -> list[int]:
    """Find the guardian that a process has started."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (entry / "cmdline").read_bytes()
            parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if parent == pid and b"swarm_ctl.run.guardian" in words:
                found.append(int(entry.name))
    return found


def count(states: dict[int, dict[str, Any]]) -> dict[str, int]:
    """Count the vehicles in each phase."""
    phases = [state.get("phase", "-") for state in states.values()]
    return {phase: phases.count(phase) for phase in sorted(set(phases))}


def fly_and_kill(session: Session, moments_s: list[float], *, spare_guardian: bool) -> list[Kill]:
    """Fly to the end, killing at moments after the first take-off; give what each kill did."""
    session.start()
    while not any(state.get("phase") in IN_FLIGHT for state in session.states().values()):
        wait(session)
    began_s, kills = time.monotonic(), []
    for number, moment_s in enumerate(moments_s):
        while time.monotonic() < began_s + moment_s:
            wait(session)
        session.kill(spare_guardian=spare_guardian)
        killed_s = time.monotonic()
        lines, is_intact = session.check()
        states, sizes = session.states(), session.sizes()
        flying = {sysid for sysid, state in states.items() if state.get("phase") in IN_FLIGHT}
        session.start()
        next_s = began_s + (moments_s[number + 1] if number + 1 < len(moments_s) else math.inf)
        taken_over_s = None
        while taken_over_s is None and time.monotonic() < next_s:
            wait(session)
            if all(session.sizes()[sysid] > sizes[sysid] for sysid in flying):
                taken_over_s = time.monotonic() - killed_s
        kills.append(Kill(killed_s - began_s, count(states), taken_over_s, lines, is_intact))
        print(row(number + 1, kills[-1]), flush=True)
    session.process.wait()
    return kills


def wait(session: Session) -> None:
    """Wait a little, while there is something to wait for."""
    if session.process.poll() is not None:
        raise SystemExit(f"the flight ended: {(session.folder / 'said.txt').read_text()}")
    time.sleep(POLL_S)  # noqa: TID251 - other processes are watched


def row(number: int, kill: Kill) -> str:
    """Lay one kill out as a line of the table."""
    phases = ", ".join(f"{how_many} {phase}" for phase, how_many in kill.phases.items())
    taken = "-" if kill.taken_over_s is None else f"{kill.taken_over_s:.1f}"
    intact = "intact" if kill.is_intact else "BROKEN"
    return f"{number:4} {kill.moment_s:8.1f} {taken:>12} {kill.lines:7} {intact:>8}  {phases}"


def report(session: Session, kills: list[Kill]) -> bool:
    """Print what the referee and the files say; tell whether all is as it must be."""
    lines, is_intact = session.check()
    truth, tracks = session.truth()
    summary = json.loads((session.out / "summary.json").read_text())
    ends = [(one["phase"], one["reason"]) for one in summary["per_vehicle"]]
    away_m = float(np.nanmax(np.hypot(tracks[..., 0], tracks[..., 1])))
    height_m = float(np.nanmax(-tracks[..., 2]))
    limits = session.limits
    breaches = int(away_m > limits["radius_m"] + OVERSHOOT_M) + int(height_m > limits["ceiling_m"])
    intact = sum(kill.is_intact for kill in kills)
    complete = sum(phase == "done" for phase, _ in ends)
    print(f"farthest from its start {away_m:.2f} m (fence {limits['radius_m']:g} m), ", end="")
    print(f"highest {height_m:.2f} m (ceiling {limits['ceiling_m']:g} m)")
    print(f"nearest two vehicles {truth['min_separation_m']:.2f} m; covered ", end="")
    print(f"{truth['coverage_fraction']:.0%}; {summary['duration_s']:.0f} s; {lines} lines")
    for sysid, (phase, reason) in enumerate(ends, start=1):
        if phase != "done" or reason:
            print(f"vehicle {sysid}: {phase} {reason}")
    is_fine = complete == len(ends) and not truth["collisions"] and not breaches
    is_fine = is_fine and intact == len(kills) and is_intact
    print(f"{'PASSED' if is_fine else 'FAILED'}: {len(kills)} kills, ", end="")
    print(f"{truth['collisions']} collisions, {breaches} fence breaches, ", end="")
    print(f"{complete} of {len(ends)} vehicles done, ", end="")
    print(f"journals intact {intact} of {len(kills)} times")
    return is_fine


def main() -> None:
    """Print a line per kill and a verdict; exit 1 when it is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--duration", type=float, default=300.0, help="exploration time, s")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--no-guardian", action="store_true", help="kill the guardian as well")
    parser.add_argument("--keep", type=Path, help="copy the record here")
    arguments = parser.parse_args()
    chance = np.random.default_rng(arguments.seed)
    moments_s = sorted(chance.uniform(0.0, arguments.duration + 20.0, arguments.kills).tolist())
    print("kill  after s  taken over s   lines  journal  phases")
    with tempfile.TemporaryDirectory() as scratch:
        session = Session(Path(scratch), arguments.vehicles, arguments.duration, arguments.seed)
        try:
            kills = fly_and_kill(session, moments_s, spare_guardian=not arguments.no_guardian)
            is_fine = report(session, kills)
        finally:
            session.end()
            if arguments.keep:
                shutil.copytree(scratch, arguments.keep)
    sys.exit(not is_fine)


if __name__ == "__main__":
    main()
