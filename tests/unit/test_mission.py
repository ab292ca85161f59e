"""A mission file that cannot be flown is refused in one sentence that says what to change."""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from swarm_ctl.errors import ClusterError, MissionError, PhaseError, SwarmError
from swarm_ctl.mission import Mission, load_mission, mission_schema

MISSIONS = Path(__file__).parents[2] / "missions"
Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    (tmp_path / "hall.yaml").write_text("name: hall\n")

    def to_file(text: str) -> Path:
        path = tmp_path / "search.yaml"
        path.write_text(f"world: hall.yaml\nduration_s: 60\n{text}")
        return path

    return to_file


def refusal(path: Path, **overrides: Any) -> MissionError:
    with pytest.raises(MissionError) as caught:
        load_mission(path, **overrides)
    assert caught.value.path == path
    assert "\n" not in str(caught.value)
    return caught.value


# -- what is accepted ------------------------------------------------------------------------------


@pytest.mark.parametrize("path", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_mission_file_loads(path: Path) -> None:
    mission = load_mission(path)
    assert mission.name == path.stem
    assert mission.simulated.is_absolute()
    assert mission.simulated.is_file()
    assert json.loads(json.dumps(mission.dump()))["planner"]["kind"] in {"explore", "lf-pso"}


def test_the_open_field_is_the_papers() -> None:
    mission = load_mission(MISSIONS / "open_2d.yaml")
    planner = mission.planner
    assert (mission.vehicles, mission.duration_s, mission.flight.speed_m_s) == (10, 600.0, 0.2)
    assert (planner.inertia, planner.cognitive, planner.social) == (0.6, 2.0, 2.0)
    assert (planner.levy_min_m, planner.levy_max_m, planner.levy_beta) == (0.03, 20.0, 1.0)
    assert (planner.period_s, planner.avoid_distance_m, planner.keep_repulsion) == (1.0, 0.9, True)
    assert mission.limits.separation_m < 2.0, "the paper's radio reaches 2 m"


def test_the_hall_is_flown_in_three_dimensions() -> None:
    mission = load_mission(MISSIONS / "open_3d.yaml")
    assert (mission.planner.dimensions, mission.limits.ceiling_m) == (3, 5.6)
    assert (mission.planner.kind, mission.planner.repulsion_max) == ("explore", 2.0)
    assert mission.planner.footprint_m < 1.0, "less than they see, so that lanes overlap"


@pytest.mark.parametrize(
    "error",
    [
        MissionError(Path("a.yaml"), "vehicles", "must be 1"),
        ClusterError("tcp://x", "no"),
        PhaseError("landed", "TAKE_OFF"),
    ],
)
def test_an_error_says_the_same_in_another_process(error: SwarmError) -> None:
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # noqa: S301 - our own


def test_a_short_mission_gets_the_defaults(write: Write) -> None:
    mission = load_mission(write(""))
    assert (mission.name, mission.vehicles, mission.autopilot, mission.seed) == (
        "search",
        10,
        "px4",
        1,
    )
    assert mission.flight.height_m == 1.5
    assert mission.limits.wall_m == 0.5


def test_a_heading_with_nothing_beneath_means_the_defaults(write: Write) -> None:
    assert load_mission(write("flight:\nlimits:\n")) == load_mission(write(""))


def test_a_number_may_be_written_with_an_exponent(write: Write) -> None:
    assert load_mission(write("flight: {speed_m_s: 5e-1}\n")).flight.speed_m_s == 0.5


def test_the_command_line_overrides_the_file(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write("vehicles: 4\nplanner: {kind: lf-pso, inertia: 0.3}\n")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "maze.yaml").touch()
    monkeypatch.chdir(tmp_path / "elsewhere")
    mission = load_mission(
        path,
        world=Path("maze.yaml"),
        vehicles=7,
        planner="pso",
        autopilot="mixed",
        seed=99,
        duration_s=30.0,
    )
    assert mission.world == tmp_path / "elsewhere" / "maze.yaml"
    assert (mission.vehicles, mission.autopilot, mission.seed) == (7, "mixed", 99)
    assert (mission.planner.kind, mission.planner.inertia) == ("pso", 0.3)
    assert mission.duration_s == 30.0


def test_an_override_can_mend_what_the_file_lacks(tmp_path: Path, write: Write) -> None:
    path = write("")
    path.write_text("name: bare\n")
    mission = load_mission(path, world=tmp_path / "hall.yaml", duration_s=5.0)
    assert mission.name == "bare"


def test_a_mission_cannot_be_changed(write: Write) -> None:
    mission = load_mission(write(""))
    with pytest.raises(ValidationError):
        mission.vehicles = 3  # type: ignore[misc] # what must not work


def test_a_dump_can_be_loaded_again(write: Write) -> None:
    mission = load_mission(write("flight: {height_m: 2}\n"))
    again = write("")
    again.write_text(json.dumps(mission.dump()))  # JSON is YAML
    assert load_mission(again) == mission


def test_the_schema_explains_every_key() -> None:
    schema = mission_schema()
    json.dumps(schema)
    assert schema["required"] == ["duration_s"]
    blocks = [schema, *schema["$defs"].values()]
    for block in blocks:
        assert block["additionalProperties"] is False
        for name, key in block["properties"].items():
            block_of_key = schema["$defs"].get(key.get("$ref", "").rpartition("/")[2], {})
            assert {**block_of_key, **key}.get("description"), f"{name} is not explained"


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "key", "reason"),
    [
        ("planner: {inertai: 0.6}", "planner.inertai", "did you mean planner.inertia?"),
        ("vehicels: 3", "vehicels", "unknown key; did you mean vehicles?"),
        ("limits: {cieling_m: 3}", "limits.cieling_m", "did you mean limits.ceiling_m?"),
        ("inertia: 0.6", "inertia", "unknown key; did you mean planner.inertia?"),
        ("flight: {wall_m: 0.4}", "flight.wall_m", "did you mean limits.wall_m?"),
        ("flight: {qqq: 1}", "flight.qqq", "unknown key; known here are height_m, speed_m_s,"),
        ("vehicles: ten", "vehicles", "must be a whole number, not 'ten'"),
        ("vehicles: 2.5", "vehicles", "must be a whole number, not 2.5"),
        ("vehicles: yes", "vehicles", "must be a whole number, not true"),
        ("vehicles: 0", "vehicles", "must be at least 1, not 0"),
        ("vehicles: 251", "vehicles", "must be at most 250, not 251"),
        ("seed: -1", "seed", "must be at least 0, not -1"),
        ("autopilot: px5", "autopilot", "must be 'px4', 'ardupilot' or 'mixed', not 'px5'"),
        (
            "planner: {kind: ants}",
            "planner.kind",
            "must be 'lf-pso', 'levy', 'pso', 'explore' or your own as module:Class, not 'ants'",
        ),
        ("planner: {inertia: heavy}", "planner.inertia", "must be a number, not 'heavy'"),
        ("planner: {inertia: 1}", "planner.inertia", "must be less than 1, not 1"),
        ("planner: 3", "planner", "must be a block of keys, not 3"),
        ("flight: [1, 2]", "flight", "must be a block of keys, not a list"),
        ("flight: {speed_m_s: 0}", "flight.speed_m_s", "must be more than 0, not 0"),
        ("flight: {speed_m_s: fast}", "flight.speed_m_s", "must be a number, not 'fast'"),
        ("flight: {speed_m_s: .inf}", "flight.speed_m_s", "must be a finite number, not inf"),
        ("flight: {return_home: maybe}", "flight.return_home", "must be true or false"),
        ("name: a/b", "name", "may hold only letters, digits, - and _, not 'a/b'"),
        ("name: 7", "name", "must be text, not 7"),
        ("1: one", "1", "unknown key"),
        (
            "planner: {levy_min_m: 3, levy_max_m: 2}",
            "planner.levy_min_m",
            "must be at most levy_max_m (2), not 3",
        ),
    ],
)
def test_a_mistake_is_named(write: Write, text: str, key: str, reason: str) -> None:
    error = refusal(write(text))
    assert error.key == key
    assert reason in error.reason
    assert str(error) == f"{error.path}: {key}: {error.reason}"


@pytest.mark.parametrize(
    ("text", "key", "reason"),
    [
        (
            "planner: {avoid_distance_m: 0.59}\nlimits: {wall_m: 0.5}",
            "planner.avoid_distance_m",
            (
                "must be at least 0.6, which is limits.wall_m and 0.1 m, not 0.59: "
                "a vehicle would stop before it turns away"
            ),
        ),
        (
            "flight: {height_m: 3.5}",
            "flight.height_m",
            "must lie between limits.floor_m (0.4) and limits.ceiling_m (3), not at 3.5",
        ),
        (
            "flight: {height_m: 0.3}",
            "flight.height_m",
            "must lie between limits.floor_m (0.4) and limits.ceiling_m (3), not at 0.3",
        ),
        (
            "limits: {floor_m: 4}",
            "limits.floor_m",
            "must be below limits.ceiling_m (3), not 4",
        ),
        (
            "planner: {dimensions: 3}\nlimits: {floor_m: 1, ceiling_m: 1.9}",
            "planner.dimensions",
            (
                "3 needs at least 1 m between limits.floor_m (1) and limits.ceiling_m (1.9); "
                "raise the ceiling or fly in 2"
            ),
        ),
        (
            "limits: {battery_critical: 0.3}",
            "limits.battery_critical",
            "must be below limits.battery_reserve (0.25), not 0.3",
        ),
        (
            "limits: {link_hold_s: 9}",
            "limits.link_hold_s",
            "must be at most limits.link_lost_s (5), not 9",
        ),
        (
            "planner: {period_s: 1}",
            "limits.planner_stall_s",
            (
                "must be at least 1.2, which is planner.period_s and 0.2 s, not 1: "
                "every plan would count as stalled"
            ),
        ),
        (
            "limits: {max_time_s: 60}",
            "duration_s",
            "must be below limits.max_time_s (60), not 60",
        ),
        (
            "peers: radio",
            "peers",
            (
                "radio: expected autopilot, udp://GROUP:PORT[?interface=IP] for multicast, "
                "udp://ADDRESS:PORT for broadcast, or mqtt://[USER@]HOST[:PORT]"
            ),
        ),
    ],
)
def test_keys_that_do_not_fit_together_are_named(
    write: Write, text: str, key: str, reason: str
) -> None:
    error = refusal(write(text))
    assert (error.key, error.reason) == (key, reason)


def test_what_just_fits_is_flown(write: Write) -> None:
    mission = load_mission(
        write(
            "planner: {avoid_distance_m: 0.6, period_s: 0.8}\n"
            "flight: {height_m: 3}\nlimits: {wall_m: 0.5, planner_stall_s: 1.0}\n"
        )
    )
    assert math.isclose(mission.planner.avoid_distance_m, 0.6)


def test_an_unknown_key_comes_before_what_follows_from_it(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("world: m.yaml\nduration: 60\n")
    error = refusal(path)
    assert (error.key, error.reason) == ("duration", "unknown key; did you mean duration_s?")


def test_a_key_that_is_missing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("duration_s: 60\n")
    assert (
        str(refusal(path))
        == f"{path}: world: is missing; name a world file to simulate, here or by --world"
    )


@pytest.mark.parametrize("world", ["", "world: nowhere.yaml\n"])
def test_real_vehicles_need_no_world(tmp_path: Path, world: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"{world}duration_s: 60\n")
    assert load_mission(path, is_simulated=False).duration_s == 60.0
    assert refusal(path).key == "world"


def test_open_air_may_be_said_on_the_command_line_and_keeps_the_rest(write: Write) -> None:
    path = write("flight:\n  height_m: 2.5\n")
    assert not load_mission(path).flight.open_air
    flight = load_mission(path, open_air=True).flight
    assert (flight.open_air, flight.height_m) == (True, 2.5)


def test_yaml_that_breaks_off_is_named_by_line(write: Write) -> None:
    path = write("planner:\n  inertia: 0.6\n social: 2\n")
    assert refusal(path).reason.startswith("line 5: ")
    assert refusal(write("vehicles: [1, 2\n")).reason.startswith("line 4: ")
    assert refusal(write("name: \x07\n")).reason.startswith("this is not YAML: ")


def test_a_key_given_twice_is_named_by_line(write: Write) -> None:
    assert refusal(write("seed: 1\nseed: 2\n")).reason == "line 4: seed is given twice"


def test_files_that_are_no_missions(tmp_path: Path) -> None:
    missing = tmp_path / "nowhere.yaml"
    assert str(refusal(missing)) == f"{missing}: there is no such file"
    assert refusal(tmp_path).reason == "cannot be read: Is a directory"
    picture = tmp_path / "a.yaml"
    picture.write_bytes(b"\x89PNG\xff")
    assert refusal(picture).reason == "cannot be read: it is not UTF-8 text"
    for text in ("", "- a\n- b\n", "hello"):
        picture.write_text(text)
        assert refusal(picture).reason == "a mission is a block of lines like `vehicles: 10`"


def test_a_world_that_is_not_there_is_named(write: Write, tmp_path: Path) -> None:
    error = refusal(write(""), world=tmp_path / "moon.yaml")
    assert (error.key, error.reason) == ("world", f"there is no world file {tmp_path}/moon.yaml")
    path = write("")
    path.write_text("world: 5\nduration_s: 1\n")
    assert refusal(path).reason == "must be the path of a file, not 5"


def test_a_wrong_override_is_named_like_a_wrong_key(write: Write) -> None:
    assert refusal(write(""), vehicles=300).reason.startswith("must be at most 250, not 300")
    assert refusal(write(""), planner="ants").key == "planner.kind"
    assert refusal(write("planner: 3"), planner="pso").key == "planner"


def test_a_mission_built_in_code_is_checked_as_well() -> None:
    with pytest.raises(ValidationError, match=r"must be below limits\.max_time_s"):
        Mission(name="long", world=Path("w.yaml"), duration_s=5000.0)
