"""One tree of errors; the data is in attributes, the message is one sentence for a person.

What an error is built from is its `args`, so that it travels between processes.
"""

from __future__ import annotations

from pathlib import Path


class SwarmError(Exception):
    """Anything that stops a mission for a reason a person can act on."""


class MissionError(SwarmError):
    """A mission file that cannot be flown."""

    def __init__(self, path: Path, key: str, reason: str) -> None:
        self.path = path
        self.key = key
        self.reason = reason
        super().__init__(path, key, reason)

    def __str__(self) -> str:
        return (
            f"{self.path}: {self.key}: {self.reason}" if self.key else f"{self.path}: {self.reason}"
        )


class MockError(SwarmError):
    """A mock fleet that did not start or died."""


class ClusterError(SwarmError):
    """A cluster that does not answer or cannot compute."""

    def __init__(self, address: str, reason: str) -> None:
        self.address = address
        self.reason = reason
        super().__init__(address, reason)

    def __str__(self) -> str:
        return f"--cluster {self.address}: {self.reason}"


class PhaseError(SwarmError):
    """A phase change that is not in the table."""

    def __init__(self, phase: str, event: str) -> None:
        self.phase = phase
        self.event = event
        super().__init__(phase, event)

    def __str__(self) -> str:
        return f"a vehicle that is {self.phase} cannot take {self.event}"
