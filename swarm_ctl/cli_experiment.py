"""The commands that simulate in batches: `experiment` and `tune`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from swarm_ctl.cli_options import INTERRUPTED, PipeConsole
from swarm_ctl.errors import SwarmError

ExperimentFile = Annotated[
    Path, typer.Argument(help="Experiment file (YAML).", show_default=False, metavar="FILE")
]
Seed = Annotated[int | None, typer.Option(help="Seed; default: the file's.")]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder of the results; one that was interrupted is gone on with."),
]


def experiment(
    file: ExperimentFile,
    trials: Annotated[
        int | None, typer.Option(help="Trials of each cell; default: the file's.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that simulate; default: one per core.")
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(help="Simulate on the workers of a Dask scheduler, as tcp://10.0.0.5:8786."),
    ] = None,
    seed: Seed = None,
    out: Out = None,
) -> None:
    """Simulate an experiment in batches and put its figures beside the paper's.

    Ctrl-C keeps what is done; the same command goes on with it.
    """
    from swarm_ctl.experiment.report import result_lines  # noqa: PLC0415 - slow
    from swarm_ctl.experiment.sweep import run_experiment  # noqa: PLC0415 - the same

    if cluster is not None and workers is not None:
        raise SwarmError("--workers are processes of this machine; a --cluster has its own")
    with ExitStack() as stack:
        compute = None
        if cluster is not None:
            with _extra("cluster", "distributed"):
                from swarm_ctl.experiment.cluster import on_cluster  # noqa: PLC0415 - an extra
            compute = stack.enter_context(on_cluster(cluster))
        result = run_experiment(
            file,
            trials=trials,
            workers=workers,
            seed=seed,
            out=out,
            progress=stack.enter_context(bar()),
            compute=compute,
        )
    PipeConsole(highlight=False).print(result_lines(result))
    if result.is_interrupted:
        raise typer.Exit(INTERRUPTED)


def tune(
    file: ExperimentFile,
    trials: Annotated[
        int, typer.Option(help="Trials of the study, with those it has.", min=1)
    ] = 100,
    workers: Annotated[
        int, typer.Option(help="Trials at a time, each in a process of its own.", min=1)
    ] = 1,
    storage: Annotated[
        str | None,
        typer.Option(help="Where the study is kept, an Optuna URL; default: study.db in --out."),
    ] = None,
    seed: Seed = None,
    out: Out = None,
) -> None:
    """Search better planner parameters: those under `tune` in an experiment file.

    Ctrl-C keeps what is done; the same command goes on with it. The winner is measured again on a
    seed that the study has not seen.
    """
    with _extra("tune", "optuna"):
        from swarm_ctl.experiment.tune import tune_experiment  # noqa: PLC0415 - an extra
    from swarm_ctl.experiment.sweep import processes  # noqa: PLC0415 - slow
    from swarm_ctl.experiment.tuned import tuned_lines  # noqa: PLC0415 - the same

    with processes(workers) as compute, bar() as progress:
        result = tune_experiment(
            file,
            trials=trials,
            compute=compute,
            workers=workers,
            seed=seed,
            storage=storage,
            out=out,
            progress=progress,
        )
    PipeConsole(highlight=False).print(tuned_lines(result))
    if result.is_interrupted:
        raise typer.Exit(INTERRUPTED)


@contextmanager
def bar(what: str = "trials") -> Iterator[Callable[[int, int, str], None]]:
    """Show a bar; gives what is called with what is done, what there is and a few words."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as shown:
        task = shown.add_task(what, total=None, visible=False)
        yield lambda done, total, words: shown.update(
            task, completed=done, total=total, description=words, visible=True
        )


@contextmanager
def _extra(name: str, package: str) -> Iterator[None]:
    """Say how to install an extra whose package is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        reason = f"this needs {package}, which is missing: pip install 'swarm-ctl[{name}]'"
        raise SwarmError(reason) from None
