"""What every kind of run shares: who flies, what is broken on purpose, how a run is summed up."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal, NamedTuple, Self

from swarm_ctl.agent.agent import Agent, Orders
from swarm_ctl.agent.phases import Phase
from swarm_ctl.controller import Controller
from swarm_ctl.errors import SwarmError
from swarm_ctl.explore.one import warm_up
from swarm_ctl.mission import Mission
from swarm_ctl.record.folder import Mode, RunFolder
from swarm_ctl.record.own_paths import draw_own_paths
from swarm_ctl.record.plots import draw_pictures
from swarm_ctl.record.report import try_report
from swarm_ctl.record.spread import read_contacts
from swarm_ctl.record.summary import summarise, write_summary
from swarm_ctl.record.unrecorded import Record
from swarm_ctl.signing import timestamp_of

TRUTH = "truth"
"""The referee's part of a run folder; no controller reads it."""
GRACE_S = 1.0
"""Mission time beyond the loss of its link after which a dead mock's vehicle is given up."""
MOCK_DIED = "its autopilot died with the mock fleet"


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults ordered on the command line, each `KIND:SYSID@SECONDS`."""

    controllers: tuple[tuple[float, int], ...] = ()
    """Mission time and sysid of each controller to be killed."""
    mock: tuple[str, ...] = ()
    """What the mock vehicles are told, in their own words."""

    @classmethod
    def parse(cls, texts: Sequence[str], vehicles: int, first: int = 1) -> Self:
        """Sort out whose fault each one is; SwarmError names the one that cannot be.

        There are so many `vehicles`, from the sysid `first` on.
        """
        last = first + vehicles - 1
        controllers, mock = [], []
        for text in texts:
            what, _, seconds = text.partition("@")
            kind, _, sysid = what.partition(":")
            if kind != "controller":
                mock.append(text)
                continue
            try:
                fault = float(seconds), int(sysid)
            except ValueError:
                raise SwarmError(f"--fault {text}: expected controller:SYSID@SECONDS") from None
            if not first <= fault[1] <= last:
                raise SwarmError(
                    f"--fault {text}: there is no vehicle {fault[1]}; they are {first} to {last}"
                )
            if not 0.0 <= fault[0] < math.inf:
                raise SwarmError(f"--fault {text}: needs a time from 0 s on")
            controllers.append(fault)
        return cls(tuple(sorted(controllers)), tuple(mock))


class Shard(NamedTuple):
    """The part of a world's vehicles that one of several mock fleets has."""

    number: int
    """From 1 on."""
    addresses: str
    """Where all fleets hear one another, as the mock reads it."""
    vehicles: int
    """Of all shards."""
    group: int
    """Number of its MAVLink network, from 1 on."""
    sysids: range
    """Of its own vehicles."""
    is_grouped: bool = False
    """Whether there are other networks."""

    def told(self) -> dict[str, int]:
        """Tell which one it is, for its record: `join_records` reads it."""
        return {"number": self.number, "of": self.addresses.count(",") + 1, "group": self.group}


def orders_of(mission: Mission, group: int = 1) -> Orders:
    """Give what every vehicle of a mission, or of one group of it, is told before take-off."""
    return Orders(
        mission=mission.name,
        duration_s=mission.duration_s,
        planner=mission.planner,
        flight=mission.flight,
        limits=mission.limits,
        seed=mission.seed,
        frame=mission.frame,
        ranging=mission.ranging,
        group=group,
    )


def controllers_for(
    mission: Mission,
    folder: Record,
    sysids: Sequence[int] | None = None,
    *,
    delay_s: float = 0.0,
    group: int = 1,
) -> list[Controller]:
    """Build one controller per vehicle of a mission: of these sysids, or as many from 1 on.

    The first takes off `delay_s` after it is ready, the others as the mission spaces them.
    """
    orders = orders_of(mission, group)
    if mission.planner.kind == "explore":
        warm_up(mission.planner)
    spacing_s = mission.flight.start_spacing_s
    agents = [
        Agent(
            sysid,
            orders,
            start_delay_s=delay_s + index * spacing_s,
            restarts=folder.restarts(sysid),
            birth=folder.birth,
        )
        for index, sysid in enumerate(sysids or range(1, mission.vehicles + 1))
    ]
    return [Controller(index, agent, folder) for index, agent in enumerate(agents)]


def sign_with(key: bytes, controllers: Sequence[Controller], began: datetime) -> None:
    """Let all controllers sign what they send; mission time 0 is when they began."""
    for controller in controllers:
        controller.agent.sign_with(key, timestamp_of(began))


def discard(folder: RunFolder, *, is_ours: bool) -> None:
    """Remove the record of a run in which nothing flew; a folder that was there before stays."""
    folder.close()
    if is_ours:
        shutil.rmtree(folder.path)
        return
    for entry in folder.path.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def finish(
    mission: Mission,
    folder: RunFolder,
    controllers: Sequence[Controller],
    *,
    mode: Mode,
    time_s: float,
    wall_s: float,
    interrupted: bool,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Close the record: summary, pictures and report; give the summary."""
    folder.close()
    flown = any(controller.agent.explored_from_s is not None for controller in controllers)
    ended = any(controller.agent.phase is Phase.DONE for controller in controllers)
    outcome: Literal["flown", "interrupted", "failed"] = "flown" if flown and ended else "failed"
    if folder.resumed_s is not None:
        words = f"taken up after a restart at {folder.resumed_s:.0f} s; run_sha256 begins there"
        notes = [words, *notes]
    resolved, is_real = mission.dump(), mode == "fly"
    if is_real:
        resolved |= {"world": None, **_flown_by(controllers)}
    contacts = read_contacts(folder.path)
    if contacts is not None:
        contacts.write(folder.path / "contacts.json")
    summary = summarise(
        folder.path,
        mission=resolved,
        mode=mode,
        outcome="interrupted" if interrupted else outcome,
        time_s=time_s,
        wall_s=wall_s,
        results=[controller.result() for controller in controllers],
        run_sha256=folder.hash.hexdigest(),
        notes=notes,
        contacts=contacts,
    )
    if is_real:
        victims = {one.agent.sysid: one.agent.victims.seen for one in controllers}
        summary["notes"] += draw_own_paths(folder.path, summary, victims, contacts)
    else:
        summary["notes"] += draw_pictures(
            folder.path, summary, speed_m_s=mission.flight.speed_m_s, contacts=contacts
        )
    summary["notes"] += try_report(folder.path, summary)
    write_summary(folder.path, summary)
    return summary


def _flown_by(controllers: Sequence[Controller]) -> dict[str, Any]:
    """Say how many real vehicles flew and what they are, in the words of a mission."""
    kinds = {pilot.name.lower() for one in controllers if (pilot := one.agent.telemetry.autopilot)}
    kind = next(iter(kinds), "unknown") if len(kinds) < 2 else "mixed"
    return {"vehicles": len(controllers), "autopilot": kind}
