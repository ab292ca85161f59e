from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import doctor_tables
import mock_tables
import pytest
from pages import PAGES

from mock_vehicle.world.spec import WorldSpec
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.mission import Mission

ROOT = Path(__file__).parents[2]
AUTOPILOTS = ROOT / "docs" / "autopilots.md"
LOADED = re.compile(
    r"<(?:script|link|img|iframe|source)\b[^>]*\b(?:src|href)=\"?(?:https?:)?//[^ >]*"
)
"""What a page asks a network for by itself; a link is followed only by who clicks it."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("material")
    folder = tmp_path_factory.mktemp("site")
    build = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(folder),
    ]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_site_builds_without_a_warning_and_needs_no_network(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in [*pages, *site.rglob("*.css")]:
        text = page.read_text(encoding="utf-8")
        assert not LOADED.findall(text)
        assert not re.findall(r"url\([\"']?(?:https?:)?//", text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_of_a_page_leads_to_a_file(page: Path) -> None:
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        assert "://" in target or (page.parent / target).exists(), target


def test_every_page_is_in_the_navigation_and_in_the_readme() -> None:
    site, readme = (ROOT / name for name in ("mkdocs.yml", "README.md"))
    readme_text, nav = readme.read_text(encoding="utf-8"), site.read_text(encoding="utf-8")
    for page in (ROOT / "docs").rglob("*.md"):
        name = page.relative_to(ROOT / "docs").as_posix()
        assert f": {name}" in nav or f"- {name}" in nav
        is_listed = f"docs/{name}" in readme_text or name.startswith(("decisions/", "reference/"))
        assert is_listed, f"README.md does not lead to {name}"


def test_the_reference_has_every_key_of_missions_and_worlds(site: Path) -> None:
    for page, model in (("missions", Mission), ("worlds", WorldSpec)):
        text = (site / "reference" / f"{page}.html").read_text(encoding="utf-8")
        schema = model.model_json_schema()
        for described in (schema, *schema["$defs"].values()):
            for key in described["properties"]:
                assert f"<td><code>{key}</code></td>" in text


def test_the_reference_has_every_command_and_option(site: Path) -> None:
    text = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    for words in ("swarm-ctl run", "swarm-ctl schema", "--signing-key FILE", "mock-vehicle"):
        assert words in text
    assert "--virtual</code></td>\n<td>Fly in memory in virtual time" in text


def test_the_page_on_mock_vehicles_says_what_they_support() -> None:
    assert mock_tables.page() == mock_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/mock_tables.py"
    )


def test_the_page_on_the_doctor_says_what_it_looks_at() -> None:
    assert doctor_tables.page() == doctor_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/doctor_tables.py"
    )


def test_the_page_on_autopilots_names_their_streams_and_failsafes() -> None:
    words = AUTOPILOTS.read_text(encoding="utf-8").replace("`", "").replace(",", " ").split()
    for pilot in (PX4, ARDUPILOT):
        assert set(pilot.streams_hz) <= set(words)
        assert {pilot.mode_name(mode) for mode in pilot.failsafe_modes} <= {
            word.rstrip(".") for word in words
        }
