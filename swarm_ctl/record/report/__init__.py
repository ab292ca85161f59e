"""One page about a run that needs nothing but a browser: `report.html`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarm_ctl.errors import SwarmError
from swarm_ctl.record.reader import Run, telling_what_is_damaged
from swarm_ctl.record.report.page import page

REPORT = "report.html"


def write_report(path: Path, summary: Mapping[str, Any] | None = None) -> Path:
    """Write `report.html` of a run folder in one go; give where it lies.

    Raises SwarmError when the folder is none of a run, or damaged.
    """
    with telling_what_is_damaged(path):
        text = page(Run.read(path, summary))
    draft = path / "report.tmp"
    draft.write_text(text, encoding="utf-8")
    return draft.replace(path / REPORT)


def try_report(path: Path, summary: Mapping[str, Any]) -> list[str]:
    """Write `report.html` at the end of a run; a failure is a note, the run is as good."""
    try:
        write_report(path, summary)
    except OSError as error:
        return [f"no {REPORT}: {error.strerror or error}"]
    except SwarmError as error:
        return [f"no {REPORT}: {error}"]
    except Exception as error:  # noqa: BLE001 - a page about a run must not cost its record
        return [f"no {REPORT}: {type(error).__name__}: {error}"]
    return []
