"""Put bugs in on purpose, and tell at which seed the soak finds each."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from sabotage import MUTANTS, find


def main() -> None:
    """Print a line per bug; the exit status is 1 when one is not found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200, help="how many to fly at most")
    arguments = parser.parse_args()
    missed = 0
    for name in MUTANTS:
        outcome = find(name, range(1, 1 + arguments.seeds))
        found = outcome.violation if outcome is not None else None
        missed += found is None
        where = f"seed {outcome.seed}, " if outcome is not None else ""
        words = f"{found.invariant}: {found.words}" if found is not None else "not found"
        print(f"{name:32} {where}{words}", flush=True)
    sys.exit(missed > 0)


if __name__ == "__main__":
    main()
