"""The page about a run in a real browser: what is pressed, what fits, what it fetches."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser.chromium import Chromium
from flown import fly

pytestmark = pytest.mark.browser

SEEN = (
    "[...document.querySelectorAll('svg .paths > *')]"
    ".filter((path) => getComputedStyle(path).display != 'none')"
    ".map((path) => path.textContent).join()"
)
IS_SEARCHED_SEEN = "getComputedStyle(document.querySelector('.searched')).display != 'none'"
FITS = "document.documentElement.scrollWidth <= innerWidth"
FETCHED = "performance.getEntriesByType('resource').filter((one) => !one.name.startsWith('data:'))"


def test_a_vehicle_is_shown_alone_without_any_script(tmp_path: Path, browser: Chromium) -> None:
    report = fly(tmp_path, vehicles=3, duration_s=10.0) / "report.html"
    browser.open(report.as_uri())
    browser.until("document.readyState == 'complete' && !!document.querySelector('.map')")
    assert browser.run(SEEN) == "vehicle 1,vehicle 2,vehicle 3"
    browser.click("label[for=w-2]")
    assert browser.run(SEEN) == "vehicle 2"
    browser.click("label[for=w-0]")
    browser.click("label[for=l-searched]")
    assert browser.run(SEEN) == "vehicle 1,vehicle 2,vehicle 3"
    assert not browser.run(IS_SEARCHED_SEEN)
    assert browser.run(f"{FETCHED}.length") == 0
    assert browser.said == []
    for width in (1440, 390, 320):
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=800, deviceScaleFactor=1, mobile=True,
        )  # fmt: skip
        assert browser.run(FITS), f"{width} pixels: the page is wider than the screen"
