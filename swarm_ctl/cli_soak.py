"""The command `soak`: bad days by the thousand, and the one that went wrong again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from swarm_ctl.cli_experiment import bar
from swarm_ctl.cli_options import INTERRUPTED, PipeConsole
from swarm_ctl.errors import SwarmError

if TYPE_CHECKING:
    from swarm_ctl.experiment.soak.flight import Outcome
    from swarm_ctl.experiment.soak.scenario import Scenario

BROKEN = 1
"""Exit status when a promise was broken."""
SHOWN = 20
_SEEDS = re.compile(r"(\d+)(?:\.\.(\d+))?")


def soak(
    seeds: Annotated[
        str | None,
        typer.Option(help="Seeds A..B, both included, or one.", metavar="A..B"),
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(help="Fly this file of a scenario instead of seeds.", metavar="FILE"),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that fly; default: one per core.", min=1)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Append a line of JSON per seed; seeds that passed are not flown again."),
    ] = None,
    hashed: Annotated[
        bool, typer.Option("--hash", help="Keep the SHA-256 of all frames of each flight.")
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(help="Write the run folder of one flight: logs, journal, pictures."),
    ] = None,
    shrink: Annotated[
        bool, typer.Option(help="Look for the smallest scenario that fails as the first one does.")
    ] = True,
) -> None:
    """Fly missions drawn by seed in virtual time, and check after every tick what never may be.

    Worlds, starts, numbers, planners, radios, faults, orders and pilots are drawn. A flight ends
    where a promise is broken (docs/soak.md). Exit status: 0 all kept, 1 broken, 2 bad input,
    130 interrupted (the same command with --out goes on).
    """
    if (seeds is None) == (scenario is None):
        raise SwarmError("soak: name either --seeds A..B or --scenario FILE")
    console = PipeConsole(highlight=False)
    if scenario is not None:
        _one(_read(scenario), console, record=record, hashed=hashed)
        return
    wanted = _range(str(seeds))
    if record is not None:
        if len(wanted) > 1:
            raise SwarmError("--record: one flight is recorded, not a range of seeds")
        _one(_drawn(wanted[0]), console, record=record, hashed=hashed)
        return
    _many(wanted, console, workers=workers, out=out, hashed=hashed, is_shrunk=shrink)


def _many(
    seeds: range,
    console: Console,
    *,
    workers: int | None,
    out: Path | None,
    hashed: bool,
    is_shrunk: bool,
) -> None:
    from swarm_ctl.experiment.soak import seeds as many  # noqa: PLC0415 - slow

    with bar("seeds") as progress:
        outcomes, is_interrupted = many.soak(
            seeds,
            workers=workers,
            out=out,
            hashed=hashed,
            progress=lambda done, total, bad: progress(done, total, f"{bad} broken"),
        )
    broken = [one for one in outcomes if one.violation is not None]
    for one in broken[:SHOWN]:
        console.print(f"{_words(one)}\n  again: swarm-ctl soak --seeds {one.seed}..{one.seed}")
    if len(broken) > SHOWN:
        console.print(f"and {len(broken) - SHOWN} more")
    if hashed and len(outcomes) == 1:
        console.print(f"run_sha256 {outcomes[0].run_sha256}")
    for line in many.summary_lines(outcomes):
        console.print(line)
    if is_interrupted:
        raise typer.Exit(INTERRUPTED)
    if broken:
        if is_shrunk:
            _shrink(broken, console)
        raise typer.Exit(BROKEN)


def _shrink(broken: Sequence[Outcome], console: Console) -> None:
    """Write the smallest scenario that breaks what the first one broke."""
    from swarm_ctl.experiment.soak.shrink import MOST_FLIGHTS, shrink  # noqa: PLC0415 - slow

    first, violation = next((one, one.violation) for one in broken if one.violation)
    with bar("flights") as progress:
        smaller, outcome = shrink(
            _drawn(first.seed),
            violation.invariant,
            lambda flights: progress(flights, MOST_FLIGHTS, "shrinking"),
        )
    file = Path("runs") / f"soak-{first.seed}.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(smaller.text(), encoding="utf-8")
    console.print(f"smaller: {_words(outcome)}\n  again: swarm-ctl soak --scenario {file}")


def _one(scenario: Scenario, console: Console, *, record: Path | None, hashed: bool) -> None:
    from swarm_ctl.experiment.soak.flight import fly, fly_recorded  # noqa: PLC0415 - slow

    outcome = fly(scenario, hashed=hashed)
    console.print(_words(outcome))
    if hashed:
        console.print(f"run_sha256 {outcome.run_sha256}")
    if record is not None:
        with console.status("writing the record"):
            fly_recorded(scenario, record, until_s=outcome.time_s)
        console.print(f"recorded in {record}")
    if outcome.violation is not None:
        raise typer.Exit(BROKEN)


def _words(outcome: Outcome) -> str:
    flown = f"seed {outcome.seed}: {outcome.vehicles} vehicles, {outcome.time_s:.1f} s"
    if outcome.violation is None:
        return f"{flown}, every promise kept"
    broken = outcome.violation
    return f"{flown}, {broken.invariant} broken at {broken.time_s:.1f} s: {broken.words}"


def _range(text: str) -> range:
    match = _SEEDS.fullmatch(text)
    first = int(match[1]) if match else 0
    last = int(match[2] or first) if match else -1
    if last < first or last >= 2**63:
        raise SwarmError(f"--seeds {text}: expected A..B, as 1..1000, or one seed")
    return range(first, last + 1)


def _drawn(seed: int) -> Scenario:
    from swarm_ctl.experiment.soak.draw import draw  # noqa: PLC0415 - slow

    return draw(seed)


def _read(path: Path) -> Scenario:
    from swarm_ctl.experiment.soak.scenario import read_scenario  # noqa: PLC0415 - slow

    return read_scenario(path)
