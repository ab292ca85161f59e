"""A controller is killed in flight, and its successor goes on from the journal; in virtual time."""

from __future__ import annotations

import json
import math
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from flight_log import Flight
from halls import MISSION, write_hall

from mock_vehicle.faults import Fault
from mock_vehicle.fleet import STEP_S
from swarm_ctl.agent.homing import Trail
from swarm_ctl.agent.phases import Phase
from swarm_ctl.experiment.arena import STEPS_PER_TICK, Arena
from swarm_ctl.flight import controllers_for
from swarm_ctl.mission import Mission, load_mission
from swarm_ctl.model import Operator, Vec3
from swarm_ctl.record import flight_journal
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.journal import read_journal

EXPLORES = ("exploring", "avoiding")
LOUD = {"radio": {"radius_m": 30.0}}
IN_FLIGHT = (*EXPLORES, "holding")
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


class CrashFlight(Flight):
    """A flight whose controllers may be killed as SIGKILL does, and begun anew."""

    def __init__(self, mission: Mission, folder: RunFolder) -> None:
        super().__init__(Arena(mission, folder), folder)
        self.mission = mission
        self.is_guarded, self.is_dead = True, False
        self.last_words: list[bytes] = []

    def kill(self, away_s: float = 0.0) -> None:
        """End all controllers at once, without a word; the vehicles fly on as they like."""
        folder = self.folder
        folder.journal.close()
        for sysid, journal in folder._flight_journals.items():
            journal.close()
            folder.tlog(sysid).close()
        for controller in self.arena.controllers:
            controller.receive = lambda *_: None  # type: ignore[method-assign]
            controller.tick = lambda *_: b""  # type: ignore[method-assign]
        agents = [controller.agent for controller in self.arena.controllers]
        self.last_words = [agent.standstill() for agent in agents if self.is_guarded]
        self.is_dead = True
        self.wait(away_s)

    def wait(self, seconds: float) -> None:
        """Let time pass while nobody is there but the guardian, if it is wanted."""
        end_s = self.arena.now + seconds
        while self.arena.now < end_s:
            self.step()

    def step(self) -> None:
        for index, frame in enumerate(self.last_words):
            is_alone = self.arena.controllers[index].agent.phase is Phase.LOST or self.is_dead
            if is_alone and round(self.arena.now / STEP_S) % STEPS_PER_TICK == 0:
                self.arena.fleet.receive(index, frame, self.arena.now)
        self.arena.step()

    def restart(self) -> None:
        """Begin anew from what lies in the folder."""
        self.folder = RunFolder.reopen(
            self.folder.path, self.mission.dump(), range(1, self.mission.vehicles + 1)
        )
        self.folder.resumed_s = self.arena.now
        self.arena._folder = self.folder
        self.arena.controllers = controllers_for(self.mission, self.folder)
        self.is_dead = False

    def crash(self, away_s: float = 3.0) -> None:
        """Kill and restart; it has been heard again, or has ended."""
        self.kill(away_s)
        self.restart()
        end_s = self.arena.now + 1.5
        while self.arena.now < end_s and any(
            controller.agent.phase is Phase.LOST for controller in self.arena.controllers
        ):
            self.step()

    def journal(self, sysid: int) -> Path:
        return self.folder.path / "journals" / f"vehicle-{sysid:03d}.jsonl"

    def armed(self, sysid: int) -> bool:
        return self.arena.fleet.vehicles[sysid - 1].armed


Begin = Callable[..., CrashFlight]


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Begin]:
    flights: list[CrashFlight] = []

    def start(*, world: dict[str, Any] | None = None, **changes: Any) -> CrashFlight:
        blocks = {
            block: {**MISSION[block], **changes.get(block, {})}
            for block in ("planner", "flight", "limits")
        }
        file = write_hall(tmp_path, {"duration_s": 500.0, **changes, **blocks}, world)
        mission = load_mission(file)
        run = Path(tempfile.mkdtemp(dir=tmp_path))
        folder = RunFolder.create(
            run,
            mission.name,
            mission.dump(),
            seed=1,
            mode="virtual",
            journaled=range(1, mission.vehicles + 1),
        )
        flights.append(CrashFlight(mission, folder))
        return flights[-1]

    yield start
    for flight in flights:
        flight.folder.close()


def exploring(begin: Begin, seconds: float = 10.0, **changes: Any) -> CrashFlight:
    flight = begin(**changes)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(seconds)
    return flight


def strike(flight: Flight, kind: str, duration_s: float | None = None, **values: Any) -> None:
    flight.arena.fleet.strike(Fault(0.0, 1, kind, duration_s, values), flight.arena.now)


# -- it goes on ----------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("away_s", [0.2, 3.0, 6.0])
def test_a_successor_takes_the_vehicle_over_and_explores_on(
    begin: Begin, autopilot: str, away_s: float
) -> None:
    flight = exploring(begin, autopilot=autopilot, duration_s=40.0)
    began_s = flight.agent(1).explored_from_s or 0.0
    flight.crash(away_s)
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=10)
    assert flight.agent(1).explored_from_s == began_s
    flight.fly_to_the_end()
    assert flight.all_in("done")
    for controller in flight.arena.controllers:
        assert controller.agent.trouble == ""
        home = controller.agent.telemetry.position_ned_m
        assert math.hypot(home.x, home.y) < 1.0
    assert flight.truth()["collisions"] == 0
    assert flight.arena.now == pytest.approx(began_s + 40.0 + 30.0, abs=30.0)


def test_a_vehicle_in_the_failsafe_of_its_autopilot_is_taken_over_as_well(begin: Begin) -> None:
    height = {"height_m": 3.0}  # it sinks
    flight = exploring(begin, vehicles=1, autopilot="px4", duration_s=40.0, flight=height)
    flight.is_guarded = False
    flight.kill(away_s=1.5)
    assert flight.arena.fleet.vehicles[0].autopilot.in_failsafe  # type: ignore[attr-defined]
    flight.restart()
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=10)
    flight.fly_to_the_end()
    assert flight.agent(1).trouble == ""


def test_the_journal_says_nothing_until_its_successor_has_the_stick(begin: Begin) -> None:
    flight = exploring(begin, vehicles=1)
    flight.kill()
    before = flight.journal(1).stat().st_size
    flight.restart()
    while flight.agent(1).phase is Phase.LOST:
        assert flight.journal(1).stat().st_size == before, "the guardian would let go"
        flight.step()
    assert flight.journal(1).stat().st_size > before


def test_a_controller_may_die_again_and_again(begin: Begin) -> None:
    flight = begin(vehicles=3, duration_s=30.0, autopilot="mixed")
    while not flight.arena.is_over:
        flight.fly(4.1)
        if not flight.arena.is_over:
            flight.crash(away_s=1.0)
    assert flight.all_in("done")
    assert [c.agent.trouble for c in flight.arena.controllers] == ["", "", ""]
    assert flight.truth()["collisions"] == 0


def watch_trails(monkeypatch: pytest.MonkeyPatch) -> dict[Trail, list[Vec3]]:
    """Note where every trail enters its cells, from now on."""
    entered: dict[Trail, list[Vec3]] = defaultdict(list)
    mark = Trail.mark

    def watched(trail: Trail, place: Vec3) -> None:
        before = trail._here
        mark(trail, place)
        if trail._here != before:
            entered[trail].append(place)

    monkeypatch.setattr(Trail, "mark", watched)
    return entered


@pytest.mark.parametrize("kind", ["lf-pso", "explore"])
def test_what_was_known_is_known_again(
    begin: Begin, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    entered = watch_trails(monkeypatch)
    flight = exploring(begin, 40.0, vehicles=3, planner={"kind": kind}, world=LOUD)
    before = [flight.agent(sysid) for sysid in (1, 2, 3)]
    flight.kill()
    flight.restart()
    for old, new in zip(before, [flight.agent(sysid) for sysid in (1, 2, 3)], strict=True):
        assert new.victims.seen.keys() == old.victims.seen.keys()
        assert new.victims.known.keys() == old.victims.known.keys()
        marks = len(entered[new.trail])
        assert 10 < len(entered[old.trail]) - 4 <= marks, "a second old at most"
        assert entered[new.trail] == entered[old.trail][:marks]
        if old.explorer is not None and new.explorer is not None:
            for origin in (1, 2, 3):
                entries = new.explorer.trails.entries(origin)
                assert entries == old.explorer.trails.entries(origin)[: len(entries)]
                assert len(entries) > 10
            own = old.sysid
            assert new.explorer.trails.length(own) == old.explorer.trails.length(own)
            assert new.explorer.written_off == old.explorer.written_off


def test_a_victim_is_reported_once_also_by_a_successor(begin: Begin) -> None:
    flight = exploring(begin, 1.0, vehicles=3, world=LOUD)
    flight.fly_until(
        lambda: all(flight.agent(sysid).victims.known for sysid in (1, 2, 3)), within_s=300.0
    )
    flight.crash()
    flight.fly(8.0)
    events = read_journal(flight.folder.path / "events.jsonl")
    reports = [one for one in events if one["event"] in {"VictimFound", "VictimHeard"}]
    assert sorted(one["sysid"] for one in reports) == [1, 2, 3]
    assert [one["event"] for one in reports].count("VictimFound") == 1
    assert [one["event"] for one in events].count("ControllerRestarted") == 3


def test_the_map_is_the_same_but_for_a_hand_s_breadth(begin: Begin) -> None:
    flight = exploring(begin, 40.0, vehicles=3, planner={"kind": "explore"})
    explorer = flight.agent(1).explorer
    assert explorer is not None
    before = explorer.memory
    flight.kill()
    flight.restart()
    explorer = flight.agent(1).explorer
    assert explorer is not None
    after = explorer.memory
    seen = [
        (bool(before.flags((x / 10, y / 10)) & 1), bool(after.flags((x / 10, y / 10)) & 1))
        for x in range(-100, 100)
        for y in range(-100, 100)
    ]
    assert sum(one for one, _ in seen) > 1000
    differ = sum(one != other for one, other in seen)
    assert differ < 0.1 * sum(one for one, _ in seen)


def test_peers_are_never_told_two_things_under_one_number(begin: Begin) -> None:
    flight = exploring(begin, 10.0, vehicles=2, planner={"kind": "explore"}, world=LOUD)
    for _ in range(4):
        flight.crash(away_s=1.0)
        flight.fly(8.0)
    one, other = (flight.agent(sysid).explorer for sysid in (1, 2))
    assert one is not None
    assert other is not None
    for origin in (1, 2):
        copies = [explorer.trails.entries(origin) for explorer in (one, other)]
        shorter = min(map(len, copies))
        assert shorter > 10
        assert copies[0][:shorter] == copies[1][:shorter]


def test_peers_are_told_of_nothing_that_is_not_written_down(begin: Begin) -> None:
    flight = exploring(begin, 1.0, vehicles=2, planner={"kind": "explore"}, world=LOUD)
    other = flight.agent(2).explorer
    assert other is not None
    for _ in range(1000):
        flight.arena.step()
        written = flight.arena.controllers[0]._diary._told[1]
        assert other.trails.length(1) <= written
    assert other.trails.length(1) > 20


def test_a_level_way_home_leads_over_low_ground_at_its_own_height(begin: Begin) -> None:
    flight = exploring(begin, vehicles=1)
    agent = flight.agent(1)
    here = agent.telemetry.position_ned_m
    agent.trail.mark(here._replace(z=-0.2))  # where a failsafe had sunk it
    agent.trail.mark(here)
    way = agent.way_home(own=True)
    assert len(way) > 1
    assert {place.z for place in way} == {agent.telemetry.position_ned_m.z}


def test_what_a_power_failure_took_from_the_end_hides_nothing_new_from_peers(
    begin: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = exploring(begin, 20.0, vehicles=2, planner={"kind": "explore"}, world=LOUD)
    flight.kill()
    lines = flight.journal(1).read_bytes().splitlines(keepends=True)
    flight.journal(1).write_bytes(b"".join(lines[:-3]))  # what the disk had
    monkeypatch.setattr(flight_journal, "boot_id", lambda: "after the next boot")
    flight.restart()
    one, other = (flight.agent(sysid).explorer for sysid in (1, 2))
    assert one is not None
    assert other is not None
    told = other.trails.length(1)
    known = one.trails.length(1)
    assert known > told, "nobody takes a new entry for one that is known"
    flight.fly(15.0)
    entries = one.trails.entries(1)
    assert len(entries) > known + 5
    assert other.trails.entries(1)[known:] == entries[known : other.trails.length(1)]
    assert other.trails.length(1) > known


# -- every phase ---------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("moment_s", [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 7.0, 9.0])
def test_it_may_die_before_and_during_the_take_off(
    begin: Begin, autopilot: str, moment_s: float
) -> None:
    flight = begin(autopilot=autopilot, duration_s=10.0)
    flight.fly(moment_s)
    flight.crash(away_s=0.6)
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=60)
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert flight.truth()["collisions"] == 0


def test_who_was_on_the_way_home_flies_home(begin: Begin) -> None:
    flight = exploring(begin)
    flight.arena.order(Operator.RETURN)
    flight.fly(0.3)
    assert flight.all_in("returning", "landing")
    flight.crash()
    flight.fly_until(lambda: flight.all_in("returning", "landing", "done"), within_s=10)
    flight.fly_to_the_end()
    assert all("return ordered" in c.agent.trouble for c in flight.arena.controllers)


@BOTH
def test_a_landing_goes_on(begin: Begin, autopilot: str) -> None:
    flight = exploring(begin, autopilot=autopilot)
    flight.arena.order(Operator.LAND)
    flight.fly(2.0)
    flight.crash(away_s=1.0)
    flight.fly_until(lambda: flight.all_in("landing"), within_s=3)
    flight.fly_to_the_end()
    assert flight.all_in("done")


def test_a_vehicle_that_landed_meanwhile_is_done(begin: Begin) -> None:
    flight = exploring(begin)
    flight.is_guarded = False
    flight.crash(away_s=60.0)
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert "its controller was away for" in flight.agent(1).trouble
    assert "on the ground" in flight.agent(1).trouble


def test_a_paused_vehicle_stays_paused(begin: Begin) -> None:
    flight = exploring(begin)
    flight.arena.order(Operator.PAUSE)
    flight.fly(1.0)
    flight.crash(away_s=1.0)
    flight.fly(20.0)
    assert flight.all_in("holding")
    flight.arena.order(Operator.RESUME)
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=3)


def test_a_mission_that_was_over_stays_over(begin: Begin) -> None:
    flight = exploring(begin, 1.0)
    flight.agent(1).fail("given up", flight.arena.now)
    flight.fly(1.0)
    flight.crash(away_s=1.0)
    assert flight.agent(1).phase is Phase.FAILED
    assert flight.agent(1).trouble == "given up"
    assert flight.agent(2).phase.value in IN_FLIGHT


# -- who has the stick ---------------------------------------------------------------------------


@BOTH
def test_a_vehicle_that_a_pilot_took_is_never_taken_back(begin: Begin, autopilot: str) -> None:
    flight = exploring(begin, autopilot=autopilot)
    pilot_takes(flight)
    flight.fly_until(lambda: flight.agent(1).phase is Phase.YIELDED, within_s=5)
    if autopilot == "ardupilot":  # PX4 would not stay in its offboard mode without setpoints
        pilot_chooses(flight, (1.0, 4.0, 0.0))  # GUIDED, but not for us, who were told to keep off
    flight.crash(away_s=1.0)
    heard = len(flight.arena.fleet.vehicles[0].setpoint_times)
    flight.fly(5.0)
    assert flight.agent(1).phase is Phase.YIELDED
    assert len(flight.arena.fleet.vehicles[0].setpoint_times) == heard
    flight.agent(1).order(Operator.RESUME, flight.arena.now)
    flight.fly_until(lambda: flight.agent(1).phase.value in EXPLORES, within_s=30)


@BOTH
def test_a_pilot_who_took_it_while_nobody_was_there_keeps_it(begin: Begin, autopilot: str) -> None:
    flight = exploring(begin, autopilot=autopilot)
    flight.kill(away_s=0.5)
    pilot_takes(flight)
    flight.wait(0.5)
    flight.restart()
    heard = len(flight.arena.fleet.vehicles[0].setpoint_times)
    flight.fly(5.0)
    assert flight.agent(1).phase is Phase.YIELDED
    assert "the pilot chose" in flight.agent(1).reason
    assert len(flight.arena.fleet.vehicles[0].setpoint_times) == heard
    assert flight.agent(2).phase.value in IN_FLIGHT


def pilot_takes(flight: Flight) -> None:
    is_px4 = flight.arena.fleet.personalities[0] == "px4"
    pilot_chooses(flight, (1.0, 4.0, 3.0) if is_px4 else (1.0, 5.0, 0.0))  # LOITER


def pilot_chooses(flight: Flight, mode: tuple[float, float, float]) -> None:
    tell(flight, 176, mode)


def tell(flight: Flight, command: int, parameters: tuple[float, float, float]) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: PLC0415

    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    frame = station.command_long_encode(1, 1, command, 0, *parameters, 0.0, 0.0, 0.0, 0.0)
    flight.arena.fleet.receive(0, bytes(frame.pack(station)), flight.arena.now)


# -- when the journal is no help -----------------------------------------------------------------


def broken(path: Path) -> None:
    lines = path.read_bytes().split(b"\n")
    lines[3] = lines[3].replace(b"1", b"2", 1)
    path.write_bytes(b"\n".join(lines))


def shortened(path: Path) -> None:
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join(lines[:3] + lines[4:]))


def of_another_mission(path: Path) -> None:
    lines = path.read_bytes().split(b"\n")
    path.write_bytes(b"\n".join([lines[0].replace(b"hall", b"mall"), *lines[1:]]))


def missing(path: Path) -> None:
    path.unlink()


@BOTH
@pytest.mark.parametrize("spoil", [broken, shortened, of_another_mission, missing])
def test_a_vehicle_whose_journal_cannot_be_used_lands(
    begin: Begin, autopilot: str, spoil: Callable[[Path], None]
) -> None:
    flight = exploring(begin, autopilot=autopilot)
    flight.kill(away_s=0.5)
    spoil(flight.journal(1))
    flight.restart()
    flight.fly_until(lambda: flight.agent(1).phase is Phase.LANDING, within_s=2)
    assert "journal" in flight.agent(1).trouble
    flight.fly_until(lambda: flight.agent(2).phase.value in EXPLORES, within_s=5)
    flight.fly_until(lambda: flight.agent(1).phase is Phase.DONE, within_s=60)
    assert not flight.armed(1)


def test_a_broken_journal_is_laid_aside_and_its_landing_survives_the_next_crash(
    begin: Begin,
) -> None:
    flight = exploring(begin)
    flight.kill()
    broken(flight.journal(1))
    flight.restart()
    assert flight.journal(1).with_suffix(".broken").exists()
    flight.crash(away_s=0.2)
    flight.fly_until(lambda: flight.agent(1).phase is Phase.LANDING, within_s=2)
    flight.crash(away_s=0.2)
    flight.fly_until(lambda: flight.agent(1).phase is Phase.LANDING, within_s=2)
    flight.fly_until(lambda: flight.agent(1).phase is Phase.DONE, within_s=60)


def test_a_torn_last_line_is_no_harm(begin: Begin) -> None:
    flight = exploring(begin)
    flight.kill()
    with flight.journal(1).open("ab") as file:
        file.write(b'{"time_s":12.3,"phase":"lan')
    flight.restart()
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=5)
    flight.crash()
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=5)


@BOTH
def test_a_position_that_cannot_be_the_old_one_s_lands_the_vehicle(
    begin: Begin, autopilot: str
) -> None:
    flight = exploring(begin, autopilot=autopilot)
    flight.kill()
    strike(flight, "drift", 1.0, fraction=0.0, jump_m=30.0, towards_deg=90.0)
    flight.wait(0.5)
    flight.restart()
    flight.fly_until(lambda: flight.agent(1).phase is Phase.LANDING, within_s=3)
    assert "from where it was left" in flight.agent(1).trouble


@BOTH
def test_a_vehicle_that_does_not_say_where_it_is_lands(begin: Begin, autopilot: str) -> None:
    flight = exploring(begin, autopilot=autopilot)
    flight.kill()
    stop_positions = (32.0, -1.0, 0.0)  # LOCAL_POSITION_NED, whose interval the last one set
    tell(flight, 511, stop_positions)
    flight.restart()
    flight.fly_until(lambda: flight.agent(1).phase is Phase.LANDING, within_s=8)
    assert "no position" in flight.agent(1).trouble


def test_an_autopilot_whose_clock_began_anew_lands_its_vehicle(begin: Begin) -> None:
    flight = exploring(begin)
    flight.kill()
    flight.restart()
    flight.agent(1).vigil.boot_s = 1e6  # as if it had flown for days before
    flight.fly_until(lambda: flight.agent(1).phase is Phase.LANDING, within_s=3)
    assert "restarted in flight" in flight.agent(1).trouble


# -- the record ----------------------------------------------------------------------------------


def test_nothing_recorded_before_the_kill_is_lost(begin: Begin) -> None:
    flight = exploring(begin, 25.0, duration_s=40.0)
    flight.kill()
    run = flight.folder.path
    files = [*run.glob("journals/*"), *run.glob("tlogs/*"), run / "events.jsonl"]
    before = {file: file.read_bytes() for file in files}
    flown_s = flight.arena.now
    flight.restart()
    flight.fly_to_the_end()
    flight.folder.close()
    for file, data in before.items():
        assert file.read_bytes().startswith(data)
        assert len(file.read_bytes()) > len(data)
    (path, _) = json.loads((run / "paths.json").read_text())["vehicles"]
    times = [point["time_s"] for point in path["waypoints"] if point["kind"] == "flown"]
    gaps = [after - one for one, after in pairwise(times)]
    assert min(times) < flown_s - 20.0
    assert max(gaps) < 3.0
    assert min(gaps) > 0.0
