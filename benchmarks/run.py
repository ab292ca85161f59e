"""Run every benchmark, one process each."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def main() -> None:
    """Print the tables one after the other."""
    here = Path(__file__)
    for script in sorted(here.parent.glob("*.py")):
        if script != here:
            print(f"\n== {script.stem}", flush=True)
            subprocess.run([sys.executable, str(script)], check=True)  # noqa: S603 - our own


if __name__ == "__main__":
    main()
