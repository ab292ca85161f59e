"""One tree of errors; the data is in attributes, the message is one sentence for a person.

What an error is built from is its `args`, so that it travels between processes.
"""

from __future__ import annotations

import errno
from pathlib import Path

ADVICE = {
    errno.EADDRINUSE: "another program listens there already; end it, or take another port",
    errno.EADDRNOTAVAIL: "this machine has no such address; 0.0.0.0 stands for all that it has",
    errno.EACCES: "this user may not use it; change its owner or permissions, or name another",
    errno.ENODEV: "there is no such device; is it plugged in?",
    errno.ENOSPC: "the disk is full; make room, or name a folder on another one",
    errno.EROFS: "nothing can be written there; name another folder",
    errno.EEXIST: "this is a file; name a folder",
    errno.ENOTDIR: "part of its path is a file; name another folder",
}
"""What an error of the system means to a person, and what to do."""


def plain(error: Exception) -> str:
    """Say what the system refused, and what to do where that is known."""
    number = getattr(error, "errno", None)
    if number is not None and number < 0:  # the resolver's
        return "there is no host of this name"
    return ADVICE.get(number or 0) or getattr(error, "strerror", None) or str(error)


class SwarmError(Exception):
    """Anything that stops a mission for a reason a person can act on."""


class MissionError(SwarmError):
    """A mission file that cannot be flown."""

    def __init__(self, path: Path, key: str, reason: str, option: str = "") -> None:
        self.path = path
        self.key = key
        self.reason = reason
        self.option = option
        """The option that gave the key its value; empty when the file did."""
        super().__init__(path, key, reason, option)

    def __str__(self) -> str:
        return ": ".join(filter(None, (str(self.path), self.option or self.key, self.reason)))


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
