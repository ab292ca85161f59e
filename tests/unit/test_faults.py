"""What is broken on purpose, and whose business each of it is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from mock_vehicle.errors import WorldError
from mock_vehicle.faults import Fault, FaultError, parse_fault, read_fault
from mock_vehicle.faults.describe import schema, text
from mock_vehicle.faults.kinds import KINDS
from mock_vehicle.world import WorldSpec, read_faults
from mock_vehicle.world.schema import world_schema
from swarm_ctl.errors import SwarmError
from swarm_ctl.flight import Faults


def test_controllers_are_ours_and_the_rest_is_the_mocks() -> None:
    texts = ["controller:3@90", "dead:2@60", "controller:1@5.5", "fleet@120"]
    faults = Faults.parse(texts, vehicles=3)
    assert faults.controllers == ((5.5, 1), (90.0, 3)), "in the order of their time"
    assert faults.mock == ("dead:2@60", "fleet@120")


def test_nothing_ordered_is_nothing_broken() -> None:
    assert Faults.parse([], vehicles=3) == Faults()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("controller", "expected controller:SYSID@SECONDS"),
        ("controller@3", "expected controller:SYSID@SECONDS"),
        ("controller:1", "expected controller:SYSID@SECONDS"),
        ("controller:one@3", "expected controller:SYSID@SECONDS"),
        ("controller:1@soon", "expected controller:SYSID@SECONDS"),
        ("controller:0@3", "there is no vehicle 0; they are 1 to 3"),
        ("controller:4@3", "there is no vehicle 4; they are 1 to 3"),
        ("controller:1@-1", "needs a time from 0 s on"),
        ("controller:1@nan", "needs a time from 0 s on"),
        ("controller:1@inf", "needs a time from 0 s on"),
    ],
)
def test_a_fault_that_cannot_be_is_named_with_its_reason(text: str, reason: str) -> None:
    with pytest.raises(SwarmError) as caught:
        Faults.parse(["dead:1@3", text], vehicles=3)
    assert str(caught.value) == f"--fault {text}: {reason}"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("dead:3@60", Fault(60.0, 3, "dead")),
        ("fleet@60", Fault(60.0, None, "fleet")),
        ("freeze:1@25+2.5", Fault(25.0, 1, "freeze", 2.5)),
        ("link-delay:2@10+5,delay_s=0.3", Fault(10.0, 2, "link-delay", 5.0, {"delay_s": 0.3})),
        (
            "nack@1,command=400,result=denied",
            Fault(1.0, None, "nack", None, {"command": 400.0, "result": "denied"}),
        ),
    ],
)
def test_a_fault_is_read_from_the_command_line(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("dead:3@60+5", "'dead' happens at once and takes no duration"),
        ("freeze:3@60+0", "'freeze' needs a duration of more than 0 s"),
        ("freeze:3@60+long", "'long' is no number"),
        ("freeze:3@60+nan", "'freeze' needs a duration of more than 0 s"),
        ("link-delay@1,delay=3", "delay: 'link-delay' has no such key; did you mean 'delay_s'?"),
        ("dead@1,delay_s=3", "delay_s: 'dead' has no such key; known are none"),
        ("link-delay@1,delay_s=soon", "delay_s: should be a number, not 'soon'"),
        ("link-delay@1,delay_s=nan", "delay_s: should be a number, not nan"),
        ("link-delay@1,delay_s=-1", "delay_s: should be 0 or more, not -1.0"),
        ("link-delay@1,delay_s", "expected NAME=VALUE, not 'delay_s'"),
        ("link-loss@1,fraction=2", "fraction: should be 0 to 1, not 2.0"),
        (
            "link-loss@1,direction=up",
            "direction: should be both, uplink or downlink, not 'up'",
        ),
        ("nack@1,command=1.5", "command: should be a whole number, not 1.5"),
        ("inf:3@1", "'inf' is no fault"),
        ("dead:3@inf", "'dead' needs a time from 0 s on"),
    ],
)
def test_a_fault_that_is_written_wrongly_says_why(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match="--fault") as caught:
        parse_fault(text)
    assert str(caught.value).startswith(f"--fault {text}: {reason}")


def test_what_a_fault_does_not_say_is_as_usual() -> None:
    fault = Fault(0.0, 1, "link-delay", None, {"delay_s": 0.3})
    assert (fault["delay_s"], fault["jitter_s"], fault["link"]) == (0.3, 0.0, "all")
    assert fault.lasts_s == math.inf
    assert Fault(0.0, 1, "freeze").lasts_s == 5.0
    assert Fault(0.0, 1, "ack-lost").times == math.inf


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        (3, ""),
        ({}, "kind"),
        ({"kind": "dead"}, "time_s"),
        ({"kind": "dead", "time_s": True}, "time_s"),
        ({"kind": ["dead"], "time_s": 1}, "kind"),
        ({"kind": "dead", "time_s": 1, "vehicle": "two"}, "vehicle"),
        ({"kind": "dead", "time_s": 1, "vehicle": 2.0}, "vehicle"),
        ({"kind": "freeze", "time_s": 1, "duration_s": "5"}, "duration_s"),
        ({"kind": "freeze", "time_s": 1, 7: 5}, "7"),
        ({"kind": "battery", "time_s": 1, "fraction": None}, "fraction"),
        ({"kind": "battery", "time_s": 1, "fraction": [0.1]}, "fraction"),
        ({"kind": "ack-lost", "time_s": 1, "message": 5}, "message"),
    ],
)
def test_nonsense_in_a_file_is_named_by_its_key(keys: Any, key: str) -> None:
    with pytest.raises(FaultError) as caught:
        read_fault(keys)
    assert caught.value.key == key


FAULTS = """
- {time_s: 30, vehicle: 2, kind: link-loss, duration_s: 5}
- {time_s: 30, kind: rangefinder-noise, noise_m: 0.3}
"""


def test_a_file_of_faults_is_a_list_as_in_a_world_file(tmp_path: Path) -> None:
    file = tmp_path / "faults.yaml"
    file.write_text(FAULTS)
    expected = (
        Fault(30, 2, "link-loss", 5),
        Fault(30, None, "rangefinder-noise", None, {"noise_m": 0.3}),
    )
    assert read_faults(file) == expected
    world = {"name": "yard", "size_m": [5, 5], "faults": yaml.safe_load(FAULTS)}
    assert WorldSpec.model_validate(world).faults == expected


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("- {time_s: 1, kind: link-los}", "faults[0].kind: 'link-los' is no fault; did you mean"),
        (
            "- {time_s: 1, kind: dead}\n- {time_s: 1, kind: wind-gust, speed_ms: 3}",
            "faults[1].speed_ms: 'wind-gust' has no such key; did you mean 'speed_m_s'?",
        ),
        ("- dead", "faults[0]: should hold keys like time_s: and kind:, not 'dead'"),
        ("7", "should hold keys, not 7"),
        ("faults: {}", "faults: should be a list"),
        ("- {time_s: 1, time_s: 2, kind: dead}", "time_s: is given twice"),
    ],
)
def test_a_wrong_file_of_faults_names_file_and_key(
    tmp_path: Path, content: str, reason: str
) -> None:
    file = tmp_path / "faults.yaml"
    file.write_text(content)
    with pytest.raises(WorldError) as caught:
        read_faults(file)
    assert str(caught.value).startswith(f"{file}: {reason}")


def test_the_schema_of_worlds_knows_every_kind_and_its_keys() -> None:
    items = world_schema()["properties"]["faults"]["items"]
    assert items == schema()
    known = {one["properties"]["kind"]["const"]: one["properties"] for one in items["oneOf"]}
    assert list(known) == list(KINDS)
    for name, kind in KINDS.items():
        assert set(kind.parameters) <= set(known[name])
        assert ("duration_s" in known[name]) == kind.lasts
        for key, parameter in kind.parameters.items():
            assert known[name][key]["default"] == parameter.default


def test_what_is_usual_for_a_kind_is_allowed() -> None:
    for name, kind in KINDS.items():
        Fault(0.0, None, name, kind.duration_s, {k: p.default for k, p in kind.parameters.items()})


def test_the_manual_lists_the_faults_there_are() -> None:
    manual = Path(__file__).parents[2] / "docs" / "faults.md"
    listed = manual.read_text(encoding="utf-8").split("```text\n")[1].split("\n```")[0]
    assert listed == text(), "paste the output of mock-vehicle --list-faults"
