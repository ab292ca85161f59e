"""Send what is no good frame, and see what is obeyed of it, and whether the next command is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping

from compare import Comparison, Difference
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from replay import Mock
from transcript import CLIENT, HERE, MALFORMED

READY_S = 45.0
APART_S = 0.2
STX = 0xFD


def command(sysid: int = CLIENT[0], *, old: bool = False) -> bytes:
    """Make the frame of a command that is always answered."""
    message = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, *(0,) * 6)
    sender = mavlink.MAVLink(None, sysid, CLIENT[1])
    return bytes(message.pack(sender, force_mavlink1=old))


def changed(at: int, bits: int) -> list[bytes]:
    """Turn bits of one byte over, and leave the checksum as it is."""
    frame = bytearray(command())
    frame[at] ^= bits
    return [bytes(frame)]


RECIPES: Mapping[str, Callable[[], list[bytes]]] = {
    "good": lambda: [command()],
    "checksum": lambda: changed(-1, 0xFF),
    "payload bit": lambda: changed(15, 1),
    "incompatible": lambda: changed(2, 0x40),
    "compatible": lambda: changed(3, 0x55),
    "unknown id": lambda: changed(7, 0x39),
    "cut": lambda: [command()[:10]],
    "empty": lambda: [b""],
    "lone start": lambda: [bytes([STX])],
    "many starts": lambda: [bytes([STX]) * 1400],
    "two at once": lambda: [command() * 2],
    "in two": lambda: [command()[:15], command()[15:]],
    "sysid 0": lambda: [command(0)],
    "sysid 1": lambda: [command(1)],
    "sysid 254": lambda: [command(254)],
    "same number": lambda: [command()] * 5,
    "MAVLink 1": lambda: [command(old=True)],
}
"""Datagrams by name."""


def compare_malformed(personality: str) -> Comparison:
    """Repeat every recorded case with one mock."""
    path = HERE / personality / f"{MALFORMED}.json"
    cases: dict[str, list[int | None]] = json.loads(path.read_text("utf-8"))
    mock = _Heard(personality)
    differences, answers = [], 0
    for case, (obeyed, alive) in cases.items():
        heard = sum(mock.answers(data) for data in RECIPES[case]()), mock.answers(command())
        differences += list(_differences(mock.now, case, (obeyed, alive), heard))
        answers += 1 + (alive is not None)
    equal = answers - len(differences)
    return Comparison(f"{personality}/{MALFORMED}", len(cases), answers, equal, differences)


def _differences(
    at_s: float, case: str, recorded: tuple[int | None, ...], heard: tuple[int, ...]
) -> Iterator[Difference]:
    for what, theirs, ours in zip(("itself", "the next command"), recorded, heard, strict=True):
        if theirs is not None and theirs != ours:
            kind = f"{what}: recorded {theirs} answers, mock {ours}"
            yield Difference(at_s, kind, case)


class _Heard:
    """A mock whose acknowledgements are counted."""

    def __init__(self, personality: str) -> None:
        self._mock = Mock(personality)
        self._mock.fly(READY_S)
        self.now = READY_S

    def answers(self, data: bytes) -> int:
        """Count the acknowledgements that follow a datagram."""
        heard = self._mock.deliver(data, self.now)
        self.now += APART_S
        heard += self._mock.fly(self.now)
        return sum(said.name == "COMMAND_ACK" for said in heard)
