"""Bugs put in on purpose, each by a patch in this process: what a soak must find."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import pytest

from swarm_ctl.agent.duties import DUTIES
from swarm_ctl.agent.geofence import Guard
from swarm_ctl.agent.phases import STREAMING, Phase
from swarm_ctl.experiment.soak.draw import draw
from swarm_ctl.experiment.soak.flight import Outcome, fly
from swarm_ctl.explore import trails
from swarm_ctl.model import ZERO


def _forget_peers(patch: pytest.MonkeyPatch) -> None:
    """Leave the peers out of the last word."""
    patch.setattr(Guard, "_peers", lambda *_: [])
    patch.setattr(Guard, "_keep_right", lambda _self, velocity, _peers: velocity)


def _steer_while_yielded(patch: pytest.MonkeyPatch) -> None:
    """Send setpoints to a vehicle that its pilot flies."""
    patch.setitem(DUTIES, Phase.YIELDED, lambda _agent: ZERO)
    patch.setattr("swarm_ctl.agent.agent.STREAMING", STREAMING | {Phase.YIELDED})


def _overlook_the_pilot(patch: pytest.MonkeyPatch) -> None:
    """Take no notice of a mode that is not ours."""
    patch.setattr("swarm_ctl.agent.watch._has_lost_the_stick", lambda _agent: False)


def _merge_twice(patch: pytest.MonkeyPatch) -> None:
    """Take entries of a trail that are known already for new ones."""
    extend = trails._Log.extend

    def extended(log: Any, kinds: Any, numbers_cm: Any, shift_m: Any) -> Any:
        again = 2 if shift_m else 1
        return extend(log, [*kinds] * again, [*numbers_cm] * again, shift_m)

    patch.setattr(trails._Log, "extend", extended)


def _forget_floor_and_ceiling(patch: pytest.MonkeyPatch) -> None:
    """Bound no vertical speed by floor and ceiling."""
    fence = Guard._fence
    patch.setattr(Guard, "_fence", lambda guard, motion: fence(guard, motion)[2:])


MUTANTS: Mapping[str, Callable[[pytest.MonkeyPatch], None]] = {
    "peers left out of the last word": _forget_peers,
    "setpoints while yielded": _steer_while_yielded,
    "a pilot overlooked": _overlook_the_pilot,
    "trails merged twice": _merge_twice,
    "no floor and no ceiling": _forget_floor_and_ceiling,
}


@contextlib.contextmanager
def sabotaged(name: str) -> Iterator[None]:
    """Put one of the bugs in, as long as the block lasts."""
    with pytest.MonkeyPatch.context() as patch:
        MUTANTS[name](patch)
        yield


def find(name: str, seeds: range) -> Outcome | None:
    """Fly seeds with a bug until one breaks a promise; None when all keep them."""
    with sabotaged(name):
        outcomes = (fly(draw(seed)) for seed in seeds)
        return next((one for one in outcomes if one.violation is not None), None)
