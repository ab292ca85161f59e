"""Run the benchmarks of docs/performance.md, a process each, and keep their figures as JSON."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

BENCHMARKS = ("codec", "raycast", "batch", "start_up", "virtual", "memory", "fleet")
"""The others of this folder take hours, or have pages of their own."""


def main() -> None:
    """Print the tables one after the other, and write a file of figures for each."""
    here = Path(__file__).parent
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"{', '.join(BENCHMARKS)}; all unless said")
    parser.add_argument("--out", type=Path, default=here.parent / "build" / "bench")
    options = parser.parse_args()
    if unknown := set(options.names) - set(BENCHMARKS):
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; there are {BENCHMARKS}")
    for name in options.names or BENCHMARKS:
        print(f"\n== {name}", flush=True)
        words = [sys.executable, str(here / f"{name}.py"), "--json", f"{options.out / name}.json"]
        subprocess.run(words, check=True)  # noqa: S603 - our own


if __name__ == "__main__":
    main()
