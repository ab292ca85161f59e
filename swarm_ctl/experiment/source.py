"""Which code flew: results of one are not those of another."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

_PACKAGES = Path(__file__).resolve().parents[2]


@functools.cache
def code_hash() -> str:
    """Give the first 12 hex digits of the SHA-256 of all our Python files, names and contents."""
    digest = hashlib.sha256()
    for package in ("mock_vehicle", "swarm_ctl"):
        for file in sorted((_PACKAGES / package).rglob("*.py")):
            digest.update(f"{file.relative_to(_PACKAGES).as_posix()}\n".encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:12]
