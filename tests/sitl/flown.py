"""`swarm-ctl fly` as a process, and what its record tells."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from sitl.simulators import Simulator

from swarm_ctl import wire

MISSION = Path(__file__).parents[2] / "missions" / "open_3d.yaml"
COMPANION = 191
LANDED_S = 120.0
"""Longest way home and down, wall time."""


class Logged(NamedTuple):
    """One frame of a telemetry log."""

    time_s: float
    """Mission time."""
    compid: int
    name: str
    values: Any


class Flown:
    """A mission that is flown, or was."""

    def __init__(
        self, out: Path, vehicles: Sequence[Simulator], *options: object, **flight: object
    ) -> None:
        """Fly, with what differs in the mission's section `flight`."""
        self.out, self.vehicles = out, vehicles
        mission = _changed(out.with_suffix(".yaml"), flight) if flight else MISSION
        links = [w for one in vehicles for w in ("--connect", one.url, "--sysid", one.sysid)]
        self._words = [str(word) for word in (mission, *links, "--out", out, *options)]
        self._said = out.with_suffix(".txt")
        self.starts()

    def starts(self) -> None:
        """Type the command, or type it again."""
        with self._said.open("a") as said:  # no pipe, which its guardian would keep open
            words = [sys.executable, "-m", "swarm_ctl", "fly", *self._words]
            self.process = subprocess.Popen(words, stdout=said, stderr=subprocess.STDOUT)

    def ends(self, within_s: float = LANDED_S) -> tuple[int, str]:
        """Wait for the end; give the exit status and what was said."""
        try:
            code = self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still flying after {within_s:g} s: {self.story()}") from None
        said = self._said.read_text()
        assert "Traceback" not in said, said
        return code, said

    def killed(self) -> None:
        """Be killed without a word."""
        self.process.kill()
        self.process.wait()

    # What its record tells.

    def events(self, name: str = "", sysid: int | None = None) -> list[dict[str, Any]]:
        file = self.out / "events.jsonl"
        lines = file.read_text().split("\n")[:-1] if file.exists() else []
        found = [json.loads(line) for line in lines]
        return [
            event
            for event in found
            if name in {"", event["event"]} and sysid in {None, event.get("sysid")}
        ]

    def phase(self, sysid: int) -> str:
        changes = self.events("PhaseChanged", sysid)
        return str(changes[-1]["data"]["after"]) if changes else "connecting"

    def reason(self, sysid: int) -> str:
        return str(self.events("PhaseChanged", sysid)[-1]["data"]["reason"])

    def waits(self, done: Callable[[], object], what: str, within_s: float = 120.0) -> float:
        """Wait until something is so, while it flies; give how long it took."""
        began = time.monotonic()
        while not done():
            took_s = time.monotonic() - began
            assert took_s < within_s, f"{what}: not within {within_s:g} s; {self.story()}"
            assert self.process.poll() is None, f"ended before {what}: {self.story()}"
            time.sleep(0.02)  # noqa: TID251 - real vehicles live in real time
        return time.monotonic() - began

    def waits_for(self, *phases: str, within_s: float = 120.0) -> float:
        """Wait until all vehicles are in one of these phases."""
        ids = [one.sysid for one in self.vehicles]
        return self.waits(
            lambda: all(self.phase(sysid) in phases for sysid in ids), " or ".join(phases), within_s
        )

    def rests(self, seconds: float) -> None:
        """Let it fly on for a while."""
        end = time.monotonic() + seconds
        self.waits(lambda: time.monotonic() > end, "a while", seconds + 5.0)

    def story(self) -> list[tuple[float, int, str, str]]:
        """Tell the changes of phase in short."""
        return [
            (e["time_s"], e["sysid"], e["data"]["after"], e["data"]["reason"])
            for e in self.events("PhaseChanged")
        ]

    def summary(self) -> dict[str, Any]:
        return dict(json.loads((self.out / "summary.json").read_text()))

    def results(self) -> dict[int, tuple[str, str]]:
        """Give each sysid's last phase and what was wrong."""
        return {
            one["sysid"]: (one["phase"], one["reason"]) for one in self.summary()["per_vehicle"]
        }

    def track(self, sysid: int) -> list[tuple[float, float, float]]:
        """Give where a vehicle said that it was, NED."""
        said = (line for line in self.log(sysid) if line.name == "LOCAL_POSITION_NED")
        return [(line.values.x, line.values.y, line.values.z) for line in said]

    def said_while(self, sysid: int, phase: str) -> set[str]:
        """Name what the controller said to its vehicle while it was in a phase."""
        changes = self.events("PhaseChanged", sysid)
        times = [*(e["time_s"] for e in changes), math.inf]
        spans = [
            (times[number], times[number + 1] - 0.01)  # the times of events are rounded
            for number, e in enumerate(changes)
            if e["data"]["after"] == phase
        ]
        ours = (line for line in self.log(sysid) if line.compid == COMPANION)
        return {
            line.name for line in ours if any(start < line.time_s < end for start, end in spans)
        }

    def log(self, sysid: int) -> Iterator[Logged]:
        """Read a vehicle's telemetry log: what it said and what was said to it."""
        data = (self.out / "tlogs" / f"vehicle-{sysid:03d}.tlog").read_bytes()
        started = json.loads((self.out / "mission.json").read_text())["started_utc"]
        epoch_s = datetime.fromisoformat(started).timestamp()
        parser, at = wire.Parser(None), 0
        while at + 10 < len(data):
            stamp_us, end = struct.unpack_from(">Q", data, at)[0], at + 8 + 12 + data[at + 9]
            for frame in parser.feed(data[at + 8 : end]):
                if frame.sysid == sysid:
                    name = wire.message(frame.id).name
                    yield Logged(stamp_us * 1e-6 - epoch_s, frame.compid, name, frame.values)
            at = end


def _changed(file: Path, flight: Mapping[str, object]) -> Path:
    mission = yaml.safe_load(MISSION.read_text())
    del mission["world"]
    mission["flight"] |= flight
    file.write_text(yaml.safe_dump(mission))
    return file
