import asyncio
import importlib.util
from importlib.machinery import ModuleSpec

import pytest

from swarm_ctl import event_loop

find_spec = importlib.util.find_spec


def without_uvloop(name: str) -> ModuleSpec | None:
    return None if name == "uvloop" else find_spec(name)


async def whose_loop() -> str:
    return type(asyncio.get_running_loop()).__module__.partition(".")[0]


def test_uvloop_runs_what_lives_in_real_time_where_it_is_installed() -> None:
    pytest.importorskip("uvloop", reason="the extra `fast` is not installed")
    assert event_loop.run(whose_loop()) == "uvloop"


def test_without_uvloop_the_standard_librarys_loop_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", without_uvloop)
    assert event_loop.run(whose_loop()) == "asyncio"


def test_what_is_raised_inside_comes_out() -> None:
    async def fail() -> None:
        raise OSError("no such port")

    with pytest.raises(OSError, match="no such port"):
        event_loop.run(fail())
