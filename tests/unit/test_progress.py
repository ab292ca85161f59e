"""What an operator sees while a swarm flies, in a terminal and in a log."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from swarm_ctl.mission import Mission
from swarm_ctl.model import Snapshot, Vec3
from swarm_ctl.progress import STYLES, ProgressView, header, plain_line, score, table

MISSION = Mission(name="usar_office", world=Path("office.yaml"), duration_s=300.0)
REFEREE = {
    "coverage_fraction": 0.4567,
    "victims_found": 2,
    "victims_total": 6,
    "collisions": 0,
    "min_separation_m": 0.94,
}


class Wall:
    """A wall clock that a test turns."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def vehicle(sysid: int, phase: str = "exploring", *, victims: int = 0, note: str = "") -> Snapshot:
    return Snapshot(
        sysid=sysid,
        phase=phase,
        position_ned_m=Vec3(3.0, 4.0, -1.52),
        battery_fraction=0.83,
        peers=(2, 3),
        victims=victims,
        note=note,
    )


def screen(renderable: object, *, width: int = 100) -> str:
    console = Console(width=width, file=io.StringIO(), force_terminal=True, color_system=None)
    with console.capture() as capture:
        console.print(renderable)
    return capture.get()


def terminal(height: int = 40) -> Console:
    return Console(file=io.StringIO(), force_terminal=True, width=100, height=height, record=True)


def test_three_vehicles_have_a_row_each() -> None:
    swarm = [vehicle(1), vehicle(2, "avoiding", victims=1), vehicle(3, note="link back")]
    lines = screen(table(swarm)).splitlines()
    assert len(lines) == 4
    assert lines[0].split() == ["vehicle", "phase", "height", "battery", "hears", "victims", "note"]
    assert lines[2].split() == ["2", "avoiding", "1.5", "m", "83%", "2", "1"]
    assert lines[3].rstrip().endswith("link back")


def test_the_header_has_the_time_and_what_the_referee_counts() -> None:
    text = screen(header(MISSION, 83.4, 3.98, score(REFEREE)))
    assert "usar_office  1:23 of 5:00 and the way home  4.0x" in text
    assert "45.7% explored  victims 2/6  contacts 0  nearest pair 0.94 m" in text


def test_before_the_referee_speaks_nothing_is_invented() -> None:
    text = screen(header(MISSION, 0.0, None, score({})))
    assert "the referee has not spoken yet" in text
    assert "%" not in text


def test_of_a_hundred_vehicles_only_those_with_something_to_say_are_listed() -> None:
    swarm = [vehicle(sysid) for sysid in range(1, 101)]
    swarm[41] = vehicle(42, "failed", note="nothing heard from its autopilot for 5.0 s")
    swarm[6] = vehicle(7, victims=2)
    swarm[9] = vehicle(10, "holding")
    lines = screen(table(swarm)).splitlines()
    assert lines[0].rstrip() == "100 vehicles: 98 exploring, 1 failed, 1 holding"
    assert [line.split()[0] for line in lines[2:]] == ["42", "10", "7"], "the worst first"


def test_a_hundred_vehicles_in_trouble_still_fit() -> None:
    swarm = [vehicle(sysid, "returning") for sysid in range(1, 101)]
    assert len(screen(table(swarm)).splitlines()) == 2 + 20
    assert len(screen(table(swarm, room=6)).splitlines()) == 2 + 5


def test_a_short_terminal_gets_the_short_table() -> None:
    swarm = [vehicle(sysid) for sysid in range(1, 11)]
    assert screen(table(swarm, room=5)).splitlines()[0].rstrip() == "10 vehicles: 10 exploring"
    assert len(screen(table(swarm, room=10)).splitlines()) == 11


def test_a_low_battery_has_something_to_say() -> None:
    swarm = [vehicle(sysid) for sysid in range(1, 31)]
    tired = vehicle(9)
    swarm[8] = Snapshot(9, tired.phase, tired.position_ned_m, 0.2, (), 0, "")
    assert "20%" in screen(table(swarm))


def test_a_vehicle_nobody_has_heard_of_yet_is_shown_as_such() -> None:
    silent = Snapshot(1, "connecting", Vec3(0.0, 0.0, 0.0), None, (), 0, "")
    row = screen(table([silent])).splitlines()[1]
    assert row.split() == ["1", "connecting", "0.0", "m", "?", "0", "0"]


def test_markup_in_a_note_is_only_text() -> None:
    assert "[red]ho[/]ho" in screen(table([vehicle(1, note="[red]ho[/]ho")]))


@pytest.mark.parametrize("vehicles", [3, 100])
def test_a_terminal_is_drawn_four_times_a_second_at_most(vehicles: int) -> None:
    console, wall = terminal(), Wall()
    swarm = [vehicle(sysid, victims=sysid % 2) for sysid in range(1, vehicles + 1)]
    drawn = 0
    with ProgressView(MISSION, console, clock=wall) as view:
        for tick in range(1000):  # ten seconds of wall time, forty of mission time
            before = console.file.tell()
            view.update(tick * 0.04, swarm, REFEREE)
            drawn += console.file.tell() > before
            wall.now_s += 0.01
    assert 39 <= drawn <= 41
    text = console.export_text()
    assert "usar_office" in text
    assert "4.0x" in text


def test_a_drawing_never_exceeds_the_terminal() -> None:
    console = terminal(height=16)
    with ProgressView(MISSION, console, clock=Wall()) as view:
        view.update(1.0, [vehicle(sysid, "landing") for sysid in range(1, 101)], REFEREE)
        assert 10 <= len(console.export_text().rstrip().splitlines()) < 16


def test_a_log_gets_a_plain_line_every_ten_seconds() -> None:
    file, wall = io.StringIO(), Wall()
    console = Console(file=file, force_terminal=False, width=40)
    swarm = [vehicle(1), vehicle(2), vehicle(3, "failed")]
    with ProgressView(MISSION, console, clock=wall) as view:
        for tick in range(250):
            view.update(tick * 0.4, swarm, REFEREE if tick else None)
            wall.now_s += 0.1
    lines = file.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0] == "    0.0 s  2 exploring, 1 failed"
    assert lines[1].startswith("   40.")
    assert lines[1].endswith("2 exploring, 1 failed; explored 45.7%; victims 2 of 6; contacts 0"), (
        "never wrapped"
    )
    assert "\x1b" not in file.getvalue()


def test_no_vehicle_at_all_is_no_crash() -> None:
    assert plain_line(0.0, [], {}) == "    0.0 s  "
    screen(table([]))


def test_every_phase_has_its_colour() -> None:
    from swarm_ctl.agent.phases import Phase  # noqa: PLC0415 - only this test knows the agent

    assert set(STYLES) == {phase.value for phase in Phase}


# -- real vehicles ---------------------------------------------------------------------------------


def test_real_vehicles_are_shown_with_what_they_know_and_how_their_links_are() -> None:
    console = terminal()
    swarm = [vehicle(1, victims=1), replace(vehicle(2), silent_s=4.2, battery_fraction=0.4)]
    with ProgressView(MISSION, console, is_real=True) as view:
        view.update(10.0, swarm)
    text = console.export_text()
    assert "victims seen 1  radio contacts 2  lowest battery 40%  silent: 2" in text
    assert "referee" not in text
    assert re.search(r"1 +exploring +1.5 m +83% +2 +1 +5.0 m", text)
    assert re.search(r"2 +exploring +1.5 m +40% +2 +0 +5.0 m +silent 4 s", text)


def test_a_vehicle_that_was_never_heard_is_told_so() -> None:
    text = screen(table([replace(vehicle(1, "connecting"), silent_s=math.inf)], is_real=True))
    assert "never heard" in text


def test_a_log_of_real_vehicles_has_what_they_know() -> None:
    console = Console(file=io.StringIO(), width=200, record=True)
    with ProgressView(MISSION, console, is_real=True) as view:
        view.update(10.0, [vehicle(1), vehicle(2)])
    assert console.export_text() == (
        "   10.0 s  2 exploring; victims seen 0; radio contacts 2; lowest battery 83%\n"
    )
