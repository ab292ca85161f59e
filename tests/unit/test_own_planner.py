from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.errors import MissionError, SwarmError
from swarm_ctl.explore.planner import PlannerParams, plan_with
from swarm_ctl.mission import load_mission

HEAD = "import numpy as np\nfrom swarm_ctl.explore.planner import Plan\n"
STILL = """
class Still:
    def __init__(self, params, *, speed_m_s, climb_m_s, seeds):
        self.n = len(seeds)
    def step(self, position_m, heading_rad, ranges_m, peers_m):
        no = np.zeros(self.n, dtype=bool)
        return Plan(np.zeros_like(position_m), heading_rad, no, position_m, no)
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_planner_beside_the_command_is_found_by_its_name(here: Path) -> None:
    (here / "still.py").write_text(HEAD + STILL, encoding="utf-8")
    params = PlannerParams(kind="still:Still")
    planner = plan_with(params, speed_m_s=1.0, climb_m_s=0.5, seeds=[1, 2])
    assert type(planner).__name__ == "Still"


@pytest.mark.parametrize(
    ("module", "text", "kind", "sentence"),
    [
        ("absent", None, "nowhere:At", "cannot import nowhere here or from what is installed"),
        ("empty", "", "empty:At", "there is no At in empty"),
        ("number", "At = 3", "number:At", "At in number should be a class with a method step"),
        ("wrong", "def (", "wrong:At", "SyntaxError"),
        ("stepless", "class At: pass", "stepless:At", "should be a class with a method step"),
        ("short", "class At:\n def step(self): ...", "short:At", "At(params, *, speed_m_s,"),
    ],
)
def test_a_planner_that_cannot_be_had_is_one_sentence(
    here: Path, module: str, text: str | None, kind: str, sentence: str
) -> None:
    if text is not None:
        (here / f"{module}.py").write_text(text, encoding="utf-8")
    mission = here / "mission.yaml"
    mission.write_text(f"duration_s: 10\nplanner: {{kind: '{kind}'}}", encoding="utf-8")
    with pytest.raises(MissionError) as refused:
        load_mission(mission, is_simulated=False)
    assert refused.value.key == "planner.kind"
    assert sentence in refused.value.reason
    assert "\n" not in str(refused.value)


def test_a_planner_that_breaks_while_it_is_built_is_one_sentence(here: Path) -> None:
    text = STILL.replace("len(seeds)", "len(seeds) / 0")
    (here / "broken.py").write_text(HEAD + text, encoding="utf-8")
    params = PlannerParams(kind="broken:Still")
    with pytest.raises(SwarmError, match=r"broken:Still could not be built: ZeroDivisionError"):
        plan_with(params, speed_m_s=1.0, climb_m_s=0.5, seeds=[1])
