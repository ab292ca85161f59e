"""STATUSTEXT put together again: a long text comes in chunks of 50 characters."""

from __future__ import annotations

from typing import Any, NamedTuple

CHUNK = 50
"""Characters in a full chunk; a shorter one is the last."""
PATIENCE_S = 1.0
"""How long the rest of a text is waited for; then what came is all there is."""
GAP = "..."


class Text(NamedTuple):
    """One thing that an autopilot said."""

    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    words: str


class _Parts(NamedTuple):
    """The chunks of one text so far, by number."""

    severity: int
    begun_s: float
    chunks: dict[int, str]

    @property
    def is_whole(self) -> bool:
        last = max(self.chunks)
        return len(self.chunks[last]) < CHUNK and len(self.chunks) == last + 1

    def text(self) -> Text:
        last = max(self.chunks)
        words = "".join(self.chunks.get(number, GAP) for number in range(last + 1))
        return Text(self.severity, words.strip())


class Texts:
    """Put the chunks of one vehicle's texts together."""

    def __init__(self) -> None:
        self._parts: dict[int, _Parts] = {}

    def hear(self, values: Any, now: float) -> list[Text]:
        """Take a STATUSTEXT; give the texts that are whole now, or will never be."""
        overdue = self.overdue(now)
        if not values.id:
            return [*overdue, Text(values.severity, values.text.strip())]
        parts = self._parts.setdefault(values.id, _Parts(values.severity, now, {}))
        parts.chunks[values.chunk_seq] = values.text
        if not parts.is_whole:
            return overdue
        return [*overdue, self._parts.pop(values.id).text()]

    def overdue(self, now: float) -> list[Text]:
        """Give the texts whose rest has not come in time."""
        late = [key for key, parts in self._parts.items() if now - parts.begun_s > PATIENCE_S]
        return [self._parts.pop(key).text() for key in late]
