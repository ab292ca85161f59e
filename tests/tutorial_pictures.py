"""Fly the tutorial, and keep its pictures: python tests/tutorial_pictures.py."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from pages import ROOT, blocks
from PIL import Image

WIDTH_PX = 900
COLOURS = 64


def fly(folder: Path) -> None:
    """Write the tutorial's files and type its recorded flights, in their order."""
    for block in blocks(ROOT / "docs" / "tutorial.md"):
        if block.title:
            (folder / block.title).write_text(block.text, encoding="utf-8")
        for words in block.commands if block.language == "sh" else ():
            if "--out" in words:
                subprocess.run(
                    [sys.executable, "-m", "swarm_ctl", *words[1:]], cwd=folder, check=True
                )


def keep(run: Path) -> None:
    """Put the picture of a run's paths into the documentation, small."""
    with Image.open(run / "paths.png") as drawn:
        small = drawn.convert("RGB")
    small.thumbnail((WIDTH_PX, WIDTH_PX * 2))
    file = ROOT / "docs" / "pictures" / f"tutorial-{run.name}.png"
    small.quantize(COLOURS).save(file, optimize=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        fly(Path(folder))
        for run in sorted((Path(folder) / "runs").iterdir()):
            keep(run)
