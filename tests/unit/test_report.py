"""The page about a run: whole, alone, true to the record, and never a reason to lose it."""

from __future__ import annotations

import json
import math
import re
import shutil
import struct
import time
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flown import fly, fly_mission
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.errors import SwarmError
from swarm_ctl.mission import load_mission
from swarm_ctl.record.reader import Run
from swarm_ctl.record.report import try_report, write_report
from swarm_ctl.record.report.findings import swept_share
from swarm_ctl.record.report.markup import join, tag
from swarm_ctl.record.report.plot import ticks
from swarm_ctl.record.sightings import sightings
from swarm_ctl.record.tlog import find_frames
from swarm_ctl.record.truth import Truth

VOID = {"meta", "img", "input", "br", "line", "rect", "path", "circle", "polygon"}


class Page(HTMLParser):
    """Reads a page as a browser does, and notes what does not fit together."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.tags: Counter[str] = Counter()
        self.ids: Counter[str] = Counter()
        self.urls: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        self.open.append(tag)
        if tag in VOID - {"path", "rect"}:
            self.open.pop()

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        values = dict(attrs)
        self.ids.update(str(values[key]) for key in ("id",) if key in values)
        self.urls += [str(values[key]) for key in ("src", "href") if key in values]

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(self.words)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of three vehicles' run that found a victim."""
    return fly(tmp_path_factory.mktemp("report"), vehicles=3, duration_s=40.0)


@pytest.fixture
def run(flown: Path, tmp_path: Path) -> Path:
    """Give a copy of it to spoil."""
    return shutil.copytree(flown, tmp_path / "copy")


def read(run: Path) -> Page:
    return Page((run / "report.html").read_text())


# -- the page --------------------------------------------------------------------------------------


def test_every_run_ends_with_a_page_that_needs_nothing_but_a_browser(flown: Path) -> None:
    page = read(flown)
    assert page.tags["script"] == page.tags["link"] == page.tags["iframe"] == 0
    assert page.urls, "the map has a picture"
    assert all(url.startswith("data:image/png;base64,") for url in page.urls)
    text = (flown / "report.html").read_text()
    assert "http" not in text
    assert "@import" not in text
    assert "url(" not in text
    assert max(page.ids.values()) == 1
    assert len(text) < 300_000


def test_the_page_says_what_the_summary_says(flown: Path) -> None:
    page, summary = read(flown).text, json.loads((flown / "summary.json").read_text())
    assert f"{summary['coverage_fraction']:.1%}" in page
    assert f"{summary['victims_found']} of {summary['victims_total']}" in page
    assert f"{summary['min_separation_m']:.2f} m" in page
    assert f"{summary['path_length_m']:,.0f} m" in page
    assert summary["run_sha256"] in page
    assert f"seed {summary['seed']}" in page


def test_the_page_has_a_section_for_everything_known(flown: Path) -> None:
    text = (flown / "report.html").read_text()
    assert re.findall("<h2>([^<]*)</h2>", text) == [
        "Map",
        "Victims",
        "Coverage over time",
        "Safety",
        "What each vehicle did",
        "Contacts over time",
        "Battery and energy",
        "Wire",
        "Mission, and how to repeat it",
    ]


def test_a_killed_run_has_a_page_of_what_it_left(run: Path) -> None:
    for name in ("summary.json", "contacts.json"):
        (run / name).unlink()
    shutil.rmtree(run / "truth")
    shutil.rmtree(run / "tlogs")
    with (run / "events.jsonl").open("a") as events:
        events.write('{"event": "Phas')
    write_report(run)
    page = read(run)
    assert "it was killed" in page.text
    assert "each path counts from its own" in page.text
    assert page.tags["h3"] == 3, "a panel for each vehicle"


def test_a_folder_with_nothing_but_its_mission_has_a_page(run: Path) -> None:
    for entry in run.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
        elif entry.name != "mission.json":
            entry.unlink()
    write_report(run)
    assert "how to repeat it" in read(run).text


def test_a_run_that_ended_as_it_began_has_a_page(run: Path) -> None:
    shutil.rmtree(run / "truth")
    shutil.rmtree(run / "tlogs")
    change = {"before": "connecting", "after": "failed", "reason": "no heartbeat"}
    entries = [
        {"event": "PhaseChanged", "time_s": 0.0, "sysid": sysid, "data": change} for sysid in (1, 2)
    ]
    (run / "events.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    (run / "paths.json").unlink()
    write_report(run)
    assert "failed: no heartbeat" in read(run).text


def test_what_vehicles_say_cannot_become_part_of_the_page(run: Path) -> None:
    text = {"text": "<script>alert(1)</script>", "severity": 2}
    entry = {"event": "StatusText", "time_s": 3.0, "sysid": 1, "data": text}
    with (run / "events.jsonl").open("a") as events:
        events.write(json.dumps(entry) + "\n")
    write_report(run)
    page = read(run)
    assert page.tags["script"] == 0
    assert "<script>alert(1)</script>" in page.text


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SwarmError, match="is no run folder"):
        write_report(tmp_path)


def test_a_page_that_cannot_be_written_costs_a_note_and_no_run(run: Path) -> None:
    (run / "report.html").unlink()
    (run / "report.html").mkdir()
    assert try_report(run, {}) == ["no report.html: Is a directory"]
    (run / "events.jsonl").write_text("no JSON\n{}\n")
    (note,) = try_report(run, {})
    assert "line 1 is not JSON" in note
    (run / "events.jsonl").write_text('{"event": "VictimFound"}\n')
    (note,) = try_report(run, {})
    assert "its record is damaged or of another version (KeyError" in note


def test_a_page_costs_less_than_a_tenth_of_a_second_for_each_vehicle(run: Path) -> None:
    write_report(run)  # what is imported late is imported now
    began_s = time.process_time()
    write_report(run)
    assert time.process_time() - began_s < 3 * 0.2


# -- how to fly it again ---------------------------------------------------------------------------


def test_a_run_repeats_bit_for_bit_from_its_folder_as_its_page_says(tmp_path: Path) -> None:
    shared = {"shared": "surveyed", "starts_m": {1: [6, 6, 0], 2: [8, 6, 0]}}
    run = fly(tmp_path, vehicles=2, duration_s=5.0, frame=shared)
    assert "swarm-ctl run run/mission.json --virtual" in read(run).text
    again = fly_mission(load_mission(run / "mission.json"), tmp_path / "again")
    hashes = [json.loads((one / "summary.json").read_text())["run_sha256"] for one in (run, again)]
    assert hashes[0] == hashes[1]


# -- victims ---------------------------------------------------------------------------------------


def test_a_victim_lies_where_the_vehicles_say_as_exactly_as_they_agree(flown: Path) -> None:
    (victim,) = sightings(Run.read(flown))
    assert victim.name == "v1"
    assert victim.error_m == pytest.approx(0.0, abs=0.05)
    assert victim.ned_m == pytest.approx((4.0, 4.0, -0.3), abs=0.05)
    assert victim.found.is_seen
    assert victim.found.time_s == min(report.time_s for report in victim.reports)


def test_reports_that_differ_make_a_victim_uncertain(run: Path) -> None:
    where = {"victim": 9, "position_ned_m": [1.0, 0.0, 0.0]}
    told = {"victim": 9, "finder": 1, "told_by": 1}
    starts = Run.read(run).starts_ned_m
    entries: list[dict[str, Any]] = [
        {"event": "VictimFound", "time_s": 5.0, "sysid": 1, "data": where}
    ]
    for sysid, off_m in ((2, 3.0), (3, 4.0)):
        shift = (a - b for a, b in zip(starts[1], starts[sysid], strict=True))
        place = [a + b for a, b in zip((1.0, off_m, 0.0), shift, strict=True)]
        data = {**told, "position_ned_m": place}
        entries.append({"event": "VictimHeard", "time_s": 6.0, "sysid": sysid, "data": data})
    with (run / "events.jsonl").open("a") as events:
        events.writelines(json.dumps(entry) + "\n" for entry in entries)
    victim = sightings(Run.read(run))[0]
    assert victim.number == 9
    assert victim.ned_m == pytest.approx(np.add(starts[1], (1.0, 0.0, 0.0))), "own eyes count"
    assert victim.accuracy_m == pytest.approx(0.29), "as PX4's estimator says"
    spread_m = np.percentile([0.0, 3.0, 4.0], 95)
    assert victim.uncertainty_m == pytest.approx(np.hypot(2 * 0.29, spread_m))
    assert victim.error_m is None, "the world has no victim 9"


# -- the bound -------------------------------------------------------------------------------------


def test_the_bound_is_that_of_the_study() -> None:
    """330 s for 400 m² and ten vehicles that see 0.3 m around themselves at 0.2 m/s."""
    arrays = {"free": np.ones((200, 200)), "cell_m": np.array(0.1)}
    mission = {"planner": {"dimensions": 2}, "flight": {"speed_m_s": 0.2}}
    truth = Truth({"sight_radius_m": 0.3}, arrays)
    began = [{"event": "Connected", "sysid": sysid} for sysid in range(1, 11)]
    run = Run(Path(), {"mission": mission}, {}, began, truth)
    share = swept_share(run, np.array([0.0, 165.0, 331.0]))  # on the way from the first moment
    assert share is not None
    assert share == pytest.approx([10 * math.pi * 0.09 / 400.0, 0.502, 1.0], abs=1e-3)


def test_nothing_is_explored_faster_than_the_bound_allows(flown: Path) -> None:
    run = Run.read(flown)
    times_s, share = (run.truth.arrays[f"coverage_{name}"] for name in ("time_s", "fraction"))
    bound = swept_share(run, times_s)
    assert bound is not None
    cell_m, area_m2 = 0.25, float(run.truth.arrays["free"].sum()) * 0.25**2
    rim = 3 * 2.0 * math.pi * cell_m / area_m2  # cells count as seen with their middles
    assert (share <= bound + rim).all()
    assert bound[-1] == pytest.approx(1.0)


def test_the_bound_of_a_volume_is_that_of_the_study() -> None:
    """76 s for 2400 m³ and ten vehicles that see 1 m around themselves at 1 m/s."""
    mission = {"planner": {"dimensions": 3}, "flight": {"speed_m_s": 1.0}}
    truth = Truth({"sight_radius_m": None, "ball_radius_m": 1.0, "searchable_m3": 2400.0})
    began = [{"event": "Connected", "sysid": sysid} for sysid in range(1, 11)]
    share = swept_share(Run(Path(), {"mission": mission}, {}, began, truth), np.array([38.0, 76.0]))
    assert share is not None
    assert share == pytest.approx([0.515, 1.0], abs=2e-3)


# -- logs ------------------------------------------------------------------------------------------


def test_a_battery_is_read_from_the_log(flown: Path) -> None:
    battery = Run.read(flown).battery(2)
    assert len(battery.time_s) > 40
    assert 0.0 <= battery.time_s[0] < 2.0
    assert np.all(np.diff(battery.left_fraction) <= 0.0)
    assert 50.0 < np.median(battery.power_w) < 400.0


def test_a_battery_that_nobody_measures_is_unknown(run: Path) -> None:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    status = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0xFFFF, -1, -1, 0, 0, 0, 0, 0, 0)
    stamped = struct.pack(">Q", 1_704_067_200_000_000) + status.pack(link)
    (run / "tlogs" / "vehicle-001.tlog").write_bytes(3 * stamped)
    battery = Run.read(run).battery(1)
    assert np.isnan(battery.left_fraction).all()
    assert np.isnan(battery.power_w).all()
    write_report(run)
    assert "nan" not in read(run).text


def test_frames_are_found_in_a_torn_log_and_not_among_noise(run: Path) -> None:
    log = run / "tlogs" / "vehicle-001.tlog"
    whole = list(find_frames(log, "SYS_STATUS", 1))
    data = log.read_bytes()
    noise = b"\xfd\xff\x00\x00\x00\x01\x01\x01\x00\x00"  # the head of one, and nothing of it
    tenth = [match.start() for match in re.finditer(rb"\xfd.{4}\x01\x01\x01\x00\x00", data)][9] - 8
    log.write_bytes(data[:tenth] + noise + data[tenth:])
    assert list(find_frames(log, "SYS_STATUS", 1)) == whole
    log.write_bytes(data[: len(data) // 2])
    half = list(find_frames(log, "SYS_STATUS", 1))
    assert 0 < len(half) < len(whole)
    assert half == whole[: len(half)]
    assert list(find_frames(log, "SYS_STATUS", 7)) == []
    assert list(find_frames(run / "nowhere.tlog", "SYS_STATUS", 1)) == []


# -- how it is written -----------------------------------------------------------------------------


def test_text_is_escaped_and_markup_is_not() -> None:
    assert tag("p", "a < b", tag("b", "&"), title='"') == (
        '<p title="&quot;">a &lt; b<b>&amp;</b></p>'
    )
    assert join("<", tag("br")) == "&lt;<br/>"


def test_an_axis_has_round_numbers() -> None:
    assert ticks(448.0, 6) == [0.0, 100.0, 200.0, 300.0, 400.0]
    assert ticks(100.0, 5) == [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]
    assert ticks(0.0, 5)[0] == 0.0
