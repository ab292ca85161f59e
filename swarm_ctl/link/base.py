"""What every link can do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Source = tuple[str, int]
"""Host and port that a datagram came from; `STREAM` where there is only one other end."""
STREAM: Source = ("", 0)
MESH: Source = ("mesh", 0)
"""What peers told beside the vehicle's own link; whole frames of companions, nothing else."""
Heard = Callable[[bytes, Source], None]
"""Takes what arrived, and where from."""


class Link(Protocol):
    """A way to an autopilot that never blocks and never raises once it is open."""

    url: str

    def watch(self, heard: Heard) -> None:
        """Let the running event loop give all that arrives to `heard`, until the link is closed."""

    def send(self, data: bytes, to: Source | None = None) -> bool:
        """Send, to who called last when none is named; False when it did not leave."""

    def reach(self, to: Source | None = None) -> str:
        """Give an address by which another process reaches the vehicle, or who spoke from `to`.

        Empty if none can.
        """

    def close(self) -> None:
        """Hear and send nothing any more."""
