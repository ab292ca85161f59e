"""Throw a million mutated frames at mock vehicles, and see that they still fly and answer."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from fuzzing import fuzz


def main() -> None:
    """Fuzz and print what happened; `--json FILE` writes it, too."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    report = fuzz(arguments.frames, arguments.seed)
    for kind, count in report.sent.items():
        print(f"{kind:28} {count:9,}")
    print(f"{'frames':28} {report.frames:9,}, of which {report.heard:,} were understood")
    print(f"{'handled per CPU-second':28} {report.frames / report.handling_s:9,.0f}")
    print(
        f"{'made and handled':28} {report.frames / report.total_s:9,.0f} in {report.total_s:.0f} s"
    )
    print(f"{'strayed at most':28} {report.strayed_m:9.2f} m")
    print(f"{'take-offs':28} {report.flights:9,}")
    print(f"{'requests answered':28} {dict(report.answered)}")
    if arguments.json:
        arguments.json.write_text(json.dumps(asdict(report), indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
