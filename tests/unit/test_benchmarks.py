from __future__ import annotations

import json
from pathlib import Path

import codec
import machine
import memory
import pytest
import run

FOLDER = Path(run.__file__).parent


def test_figures_are_kept_with_the_machine_they_were_measured_on(tmp_path: Path) -> None:
    file = tmp_path / "new" / "codec.json"
    machine.write(file, {"pack_us": 0.5})
    content = json.loads(file.read_text())
    assert content["benchmark"] == "codec"
    assert content["figures"] == {"pack_us": 0.5}
    assert content["machine"]["cores"] >= 1
    assert content["machine"]["versions"].keys() >= {"numpy", "pymavlink", "fastcrc"}
    assert content["calibration_ms"] > 0.0
    machine.write(None, {"pack_us": 0.5})
    assert [path.name for path in file.parent.iterdir()] == ["codec.json"]


@pytest.mark.parametrize("name", run.BENCHMARKS)
def test_what_make_bench_runs_writes_its_figures(name: str) -> None:
    source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    assert "machine.write(" in source
    assert '"--json"' in source


def test_a_fleet_s_frames_are_measured_both_ways() -> None:
    row = codec.measure_fleet("HEARTBEAT", 20, repeats=3)
    assert row.plain_us > 0.0
    assert (row.compiled_us is not None) == codec.is_compiled()


def test_growth_is_that_of_the_second_half() -> None:
    rows = [(0.0, 1000.0), (600.0, 9000.0), (1200.0, 9050.0)]
    assert memory.growth_kb_per_hour(rows, vehicles=5) == pytest.approx(60.0)


def test_memory_is_told_as_the_mission_goes_on() -> None:
    rows = list(memory.fly(2, 3.0, 1.0))
    assert [now for now, _ in rows] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert all(kb > 10_000.0 for _, kb in rows)
