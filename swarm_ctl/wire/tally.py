"""What has come from whom over one stream of frames, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Stats:
    """What a parser has met so far."""

    frames: int = 0
    """Frames of known ids with a right CRC, subscribed or not."""
    bad_crc: int = 0
    """Frames of known ids with a wrong CRC."""
    unknown: int = 0
    """Frames whose id is not in the dialect."""
    bad_flags: int = 0
    """Frames with an incompat flag other than "signed"."""
    skipped_bytes: int = 0
    """Bytes that belonged to no frame, or to one with a wrong CRC."""
    lost: int = 0
    """Sequence numbers that never came, over all sources; late and repeated frames do not count."""


class Tally:
    """Counts of one stream, and which frame is to come next from each source."""

    def __init__(self) -> None:
        self.stats = Stats()
        self.next_seq: dict[int, int] = {}
        """By source: its sysid, and its compid times 256; who reads a frame writes it here."""
        self._lost: dict[int, int] = {}

    def lost_of(self, sysid: int) -> int:
        """Count the lost frames of one system, over all its components."""
        return self._lost.get(sysid, 0)

    def follow(self, source: int, seq: int) -> None:
        """Count what a source has lost; half a turn behind is late or repeated, not lost."""
        lost = seq - self.next_seq.get(source, seq) & 0xFF
        if lost < 0x80:
            self.stats.lost += lost
            self._lost[source & 0xFF] = self._lost.get(source & 0xFF, 0) + lost
            self.next_seq[source] = seq + 1 & 0xFF
