"""MAVLink 2 message signing: who holds the swarm's key may speak, and nobody speaks twice.

https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import string
from collections import Counter
from collections.abc import Mapping
from datetime import UTC, datetime
from enum import Enum
from hashlib import sha256
from hmac import compare_digest
from pathlib import Path

from swarm_ctl import wire

KEY_BYTES = 32
KEY_VARIABLE = "SWARM_SIGNING_KEY"
"""Environment variable with a passphrase or 64 hexadecimal digits."""
UNITS_1_S = 100_000
"""Timestamps count steps of 10 us."""
LATEST = (1 << 48) - 1
EPOCH = datetime(2015, 1, 1, tzinfo=UTC)
OLD_UNITS = 60 * UNITS_1_S
"""The first frame of a stream may be this far behind, as a clock that is not set."""
ALLOWED_UNSIGNED = frozenset(wire.message(name).id for name in ("RADIO_STATUS", "RADIO"))
"""What telemetry radios put into a stream by themselves; they have no key."""

_MAGIC, _SIGNED = 0xFD, 0x01
_SIGNATURE_BYTES = 13
_SHORTEST = 12 + _SIGNATURE_BYTES
_SEAL_BYTES = 6


class Verdict(Enum):
    """What became of a received frame."""

    ACCEPTED = "accepted"
    UNSIGNED = "unsigned"
    FORGED = "forged"
    """Signed with another key, or changed on its way."""
    REPLAYED = "replayed"
    """Not newer than the last frame of its stream."""
    OLD = "old"
    """The first frame of a stream, more than 60 s behind us."""


def timestamp_of(moment: datetime) -> int:
    """Give the timestamp of a moment: 10 us steps since 2015-01-01, UTC."""
    return int((moment - EPOCH).total_seconds() * UNITS_1_S)


def key_of(text: str) -> bytes:
    """Read a key: 64 hexadecimal digits as they are, of anything else SHA-256.

    MAVProxy, Mission Planner and QGroundControl hash a passphrase alike.
    """
    text = text.strip()
    if len(text.splitlines()) != 1:
        raise ValueError("a key is one line: a passphrase, or 64 hexadecimal digits")
    if len(text) == 2 * KEY_BYTES and set(text) <= set(string.hexdigits):
        return bytes.fromhex(text)
    return sha256(text.encode()).digest()


def find_key(file: Path | None, environment: Mapping[str, str]) -> bytes | None:
    """Take the key from a file, or else from `SWARM_SIGNING_KEY`; None without either.

    ValueError says in one sentence what is wrong with it, and never what stands in it.
    """
    source = f"signing key {file}" if file else KEY_VARIABLE
    try:
        text = file.read_text("utf-8") if file else environment.get(KEY_VARIABLE)
        return None if text is None else key_of(text)
    except OSError as error:
        raise ValueError(f"{source}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{source}: it is no text") from None
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


class Signer:
    """One end of the links that share a key: signs what leaves, judges what arrives."""

    def __init__(self, key: bytes, timestamp: int = 0) -> None:
        """Take a key of 32 bytes, and the timestamp at which `now` is 0."""
        if len(key) != KEY_BYTES:
            raise ValueError(f"a key has {KEY_BYTES} bytes, not {len(key)}")
        self.timestamp = timestamp
        """The latest that was sent or accepted."""
        self._began = timestamp
        self._keyed = sha256(key)
        self._streams: dict[tuple[int, int, int], int] = {}

    def advance(self, now: float) -> None:
        """Let the time of signatures follow the clock; what was sent or heard may be ahead."""
        self.timestamp = max(self.timestamp, self._began + int(now * UNITS_1_S))

    def sign(self, frame: bytes, link_id: int = 0) -> bytes:
        """Sign a plain MAVLink 2 frame of our dialect; no two share a timestamp."""
        self.timestamp = min(self.timestamp + 1, LATEST)
        body = frame[1:2] + b"\x01" + frame[3:-2]
        stamp = bytes([link_id]) + self.timestamp.to_bytes(6, "little")
        signed = frame[:1] + body + wire.checksum(body) + stamp
        return signed + self._seal(signed)

    def verify(self, raw: bytes) -> Verdict:
        """Judge a received frame whose CRC is right; an accepted one moves its stream's time on."""
        is_whole = len(raw) >= _SHORTEST and len(raw) == raw[1] + 12 + _SIGNATURE_BYTES
        if not is_whole or raw[0] != _MAGIC or not raw[2] & _SIGNED:
            return Verdict.UNSIGNED
        if not compare_digest(self._seal(raw[:-_SEAL_BYTES]), raw[-_SEAL_BYTES:]):
            return Verdict.FORGED
        timestamp = int.from_bytes(raw[-12:-6], "little")
        stream = (raw[5], raw[6], raw[-13])
        last = self._streams.get(stream)
        if last is None and timestamp + OLD_UNITS < self.timestamp:
            return Verdict.OLD
        if last is not None and timestamp <= last:
            return Verdict.REPLAYED
        self._streams[stream] = timestamp
        self.timestamp = max(self.timestamp, timestamp)
        return Verdict.ACCEPTED

    def _seal(self, content: bytes) -> bytes:
        seal = self._keyed.copy()
        seal.update(content)
        return seal.digest()[:_SEAL_BYTES]


class Gatekeeper:
    """Keeps the key of one end; without a key everybody may enter and nothing is signed."""

    def __init__(self) -> None:
        self._signer: Signer | None = None
        self.refused: Counter[Verdict] = Counter()
        """Frames refused so far."""

    def take_key(self, key: bytes, timestamp: int, now: float = 0.0) -> None:
        """Take a key, and the timestamp that `now` is; zeros take the key away."""
        has_key = timestamp or any(key)
        self._signer = Signer(key, timestamp - int(now * UNITS_1_S)) if has_key else None
        self.advance(now)

    @property
    def is_open(self) -> bool:
        """Whether everybody may enter, as there is no key."""
        return self._signer is None

    @property
    def timestamp(self) -> int:
        """The latest timestamp that was sent or accepted; 0 without a key."""
        return 0 if self._signer is None else self._signer.timestamp

    def advance(self, now: float) -> None:
        """Let the time of signatures follow the clock."""
        if self._signer is not None:
            self._signer.advance(now)

    def seal(self, frame: bytes, link_id: int = 0) -> bytes:
        """Sign a frame that leaves over a link, if there is a key."""
        return frame if self._signer is None else self._signer.sign(frame, link_id)

    def refusal(self, frame: wire.Frame) -> Verdict | None:
        """Say why a frame may not enter, and count it; None lets it in."""
        if self._signer is None:
            return None
        verdict = self._signer.verify(frame.raw)
        if verdict is Verdict.ACCEPTED or frame.id in ALLOWED_UNSIGNED:
            return None
        self.refused[verdict] += 1
        return verdict
