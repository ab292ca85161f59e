"""A run played back in a real browser."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from browser.chromium import Chromium
from halls import write_hall

from swarm_ctl.cli import app

pytestmark = pytest.mark.browser

PHASES = "[...document.querySelectorAll('tbody tr')].map((row) => row.dataset.phase)"
TIME = "document.querySelector('[data-fact=time] b').textContent"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    mission = write_hall(tmp_path, {"duration_s": 15.0})
    with pytest.raises(SystemExit):
        app(["run", str(mission), "--virtual", "--out", str(tmp_path / "run")])
    return tmp_path / "run"


def test_a_run_is_played_back_with_its_slider(
    run: Path, console: Callable[..., str], browser: Chromium
) -> None:
    browser.open(console(run))
    browser.until(f"{PHASES}.join() === 'connecting,connecting'")
    slide = "const slider = document.querySelector('input[type=range]')"
    browser.run(f"(() => {{ {slide}; slider.value = slider.max;"
                " slider.dispatchEvent(new Event('input')); })()")  # fmt: skip
    browser.until(f"{PHASES}.join() === 'done,done'")
    assert browser.run("document.querySelectorAll('.log li').length") > 4
    assert browser.run("document.querySelector('.scene canvas').width") > 400
    browser.click(".play")  # from the end it begins again
    browser.until(f"{TIME} === '0:02'")
    browser.click(".speeds button:last-child")
    browser.until(f"{PHASES}.join() === 'done,done'")
    assert browser.said == []
    assert browser.hosts == {"127.0.0.1"}  # it loads nothing from a network


def test_a_stranger_sees_nothing(run: Path, console: Callable[..., str], browser: Chromium) -> None:
    address = console(run)
    browser.open(address.split("?")[0])
    said = browser.until("document.body.innerText")
    assert "open the address that swarm-ctl console printed" in said
