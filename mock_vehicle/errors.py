"""Errors of the mock: one sentence that names file and key."""

from __future__ import annotations

from pathlib import Path


class MockVehicleError(Exception):
    """Anything that stops the mock fleet for a reason a person can act on."""


class WorldError(MockVehicleError):
    """A world or map file that cannot be simulated."""

    def __init__(self, path: Path, key: str, reason: str) -> None:
        self.path = path
        self.key = key
        self.reason = reason
        super().__init__(f"{path}: {key}: {reason}" if key else f"{path}: {reason}")
