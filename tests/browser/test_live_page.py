"""A mission watched and stopped in a real browser, over a real broker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from browser.chromium import Chromium
from halls import write_hall
from mosquitto import Mosquitto
from session import Session

pytestmark = pytest.mark.browser

VEHICLES = 4
PHASES = "[...document.querySelectorAll('tbody tr')].map((row) => row.dataset.phase)"
WARNING = "document.querySelector('[role=alert]')?.textContent ?? ''"


def all_are(*phases: str) -> str:
    """Say in the page's language that every vehicle is in one of some phases."""
    return (
        f"{PHASES}.length === {VEHICLES} && {PHASES}.every((one) => {list(phases)}.includes(one))"
    )


def test_abort_pressed_in_the_browser_lands_every_vehicle(
    tmp_path: Path, broker: Mosquitto, console: Callable[..., str], browser: Chromium
) -> None:
    broker.start()
    mission = write_hall(tmp_path, {"vehicles": VEHICLES, "duration_s": 200.0})
    browser.open(console("--mqtt", broker.url))
    session = Session(mission, "--mqtt", broker.url)
    browser.until(all_are("exploring", "avoiding"))

    browser.click("[data-order=abort]")
    browser.until("document.querySelector('dialog').open")
    browser.click("dialog [value=no]")
    browser.until("!document.querySelector('dialog').open")
    assert not [event for event in session.events() if event["event"] == "OperatorOrder"]

    browser.click("[data-order=abort]")
    browser.click("dialog [data-confirm]")
    browser.until(f"document.querySelector('.answer').textContent.includes('{VEHICLES} of')")
    browser.until(all_are("done"))
    assert browser.run("document.querySelector('[data-fact=air] b').textContent") == "0/4"
    _, out, _ = session.end()
    assert session.phases() == ["done"] * VEHICLES, out
    told = [event for event in session.events() if "sysid" in event]
    ordered = [one["sysid"] for one in told if one["data"] == {"order": "abort"}]
    landed = [one["sysid"] for one in told if one["data"].get("after") == "landing"]
    assert sorted(ordered) == sorted(landed) == [1, 2, 3, 4]
    assert browser.said == []


def test_one_vehicle_is_chosen_and_held_while_the_others_go_on(
    tmp_path: Path, broker: Mosquitto, console: Callable[..., str], browser: Chromium
) -> None:
    broker.start()
    mission = write_hall(tmp_path, {"vehicles": VEHICLES, "duration_s": 200.0})
    session = Session(mission, "--mqtt", broker.url)
    browser.open(console("--mqtt", broker.url, "--mission", "hall"))
    browser.until(all_are("exploring", "avoiding"))
    browser.click("tr[data-sysid='3'] .id")
    browser.click("[data-order=pause]")
    browser.click("dialog [data-confirm]")
    browser.until(f"{PHASES}[2] === 'holding'")
    assert browser.run(f"{PHASES}.filter((one) => one === 'holding').length") == 1
    session.ctrl_c()
    session.end()


def test_a_broker_that_is_away_is_named_and_comes_back_by_itself(
    broker: Mosquitto, console: Callable[..., str], browser: Chromium
) -> None:
    browser.open(console("--mqtt", broker.url))
    browser.until(f"({WARNING}).includes('{broker.url} is away')")
    assert browser.run("document.querySelector('[data-order=abort]').disabled")
    for _ in range(2):
        broker.start()
        browser.until(f"({WARNING}) === ''")
        broker.kill()
        browser.until(f"({WARNING}).includes('is away')")
