"""One tree of errors; the data is in attributes, the message is one sentence for a person."""

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
        super().__init__(f"{path}: {key}: {reason}" if key else f"{path}: {reason}")


class MockError(SwarmError):
    """A mock fleet that did not start or died."""


class ClusterError(SwarmError):
    """A cluster that does not answer or cannot compute."""

    def __init__(self, address: str, reason: str) -> None:
        self.address = address
        self.reason = reason
        super().__init__(f"--cluster {address}: {reason}")


class PhaseError(SwarmError):
    """A phase change that is not in the table."""

    def __init__(self, phase: str, event: str) -> None:
        self.phase = phase
        self.event = event
        super().__init__(f"a vehicle that is {phase} cannot take {event}")
