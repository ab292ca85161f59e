"""Frames of one message for a whole fleet at once: numpy fills them, a compiled loop ends them.

Byte for byte what `Message.pack` makes. Import it only where it is used: it asks for numba, which
takes its time, and does without where that is not installed.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from fastcrc.crc16 import mcrf4xx
from numpy.typing import ArrayLike, NDArray

from swarm_ctl.wire.codec import V2, Message
from swarm_ctl.wire.tables import CRC_EXTRAS, Field

HEAD = [("+magic", "u1"), ("+length", "u1"), ("+flags", "<u2"), ("+seq", "u1"), ("+sysid", "u1")]
HEAD += [("+compid", "u1"), ("+id0", "u1"), ("+id1", "<u2")]
HEAD_BYTES, CRC_BYTES = 10, 2
FIRST_CRC = 0xFFFF
Bytes = NDArray[np.uint8]
Finish = Callable[[Bytes, int], list[bytes]]
"""Takes (n, bytes) whole frames with room for their CRC, and the byte that a CRC ends with."""


class Batch:
    """Makes a frame of one message for each of n vehicles."""

    def __init__(self, message: Message, sysids: ArrayLike, compid: int) -> None:
        """Take who speaks, (n,); ValueError for a sysid or compid that is none."""
        self._message = message
        layout = [(field.name, *_kind(field)) for field in message.wire_order]
        n = np.asarray(sysids).shape[0]
        rows = np.zeros(n, np.dtype([*HEAD, *layout, ("+crc", "<u2")]))
        self._bytes: Bytes = rows.view(np.uint8).reshape(n, -1)
        rows["+magic"] = V2
        rows["+length"] = self._bytes.shape[1] - HEAD_BYTES - CRC_BYTES
        rows["+id0"], rows["+id1"] = message.id & 0xFF, message.id >> 8
        self._seq = rows["+seq"]
        self._fields = [(field, rows[field.name]) for field in message.declared]
        self._extra = CRC_EXTRAS[message.id][0]
        self._fit(Field("sysid", "B", 0), rows["+sysid"], sysids)
        self._fit(Field("compid", "B", 0), rows["+compid"], compid)

    def pack(self, seqs: ArrayLike, *columns: ArrayLike) -> list[bytes]:
        """Make the frames of sequence numbers (n,) and the fields in declaration order.

        A field is (n,), one value for all, or (n, length) for arrays, which may be shorter than
        the message's; extensions at the end may be left out. ValueError names the field of a value
        that does not fit. What has the very type of the wire is quickest.
        """
        self._fit(Field("seq", "B", 0), self._seq, seqs)
        for (field, target), column in zip(self._fields, columns, strict=False):
            self._fit(field, target, column)
        for _, target in self._fields[len(columns) :]:
            target[...] = 0 if target.dtype.kind != "S" else b""
        return finish(self._bytes, self._extra)

    def _fit(self, field: Field, target: NDArray[Any], column: ArrayLike) -> None:
        values = np.asarray(column)
        if values.dtype != target.dtype and not _fits(values, target.dtype):
            raise ValueError(f"{self._message.name}.{field.name}: a value does not fit")
        if target.ndim == 1 or values.ndim == 0:
            target[...] = values
            return
        length = values.shape[-1]
        if length > field.length:
            raise ValueError(f"{self._message.name}.{field.name}: at most {field.length} fit")
        target[:, :length] = values
        target[:, length:] = 0


def _kind(field: Field) -> tuple[Any, ...]:
    """Say what numpy calls a field."""
    if field.code == "c":
        return (f"S{field.length}",)
    return (f"<{field.code}", (field.length,)) if field.length else (f"<{field.code}",)


def _fits(values: NDArray[Any], wire: np.dtype[Any]) -> bool:
    """Tell whether all values can be written as a type of the wire, as struct would write them."""
    if wire.kind == "S":
        return values.dtype.kind == "S"
    if wire.kind == "f":
        if values.dtype.kind not in "fiub":
            return False
        with np.errstate(over="ignore"):
            return bool(np.array_equal(np.isinf(values.astype(wire)), np.isinf(values)))
    if values.dtype.kind not in "iub" or not values.size:
        return values.dtype.kind in "iub"
    bounds = np.iinfo(wire)
    return bounds.min <= int(values.min()) and int(values.max()) <= bounds.max


def finish_plainly(rows: Bytes, extra: int) -> list[bytes]:
    """Cut the zeros off the ends of payloads and add the CRCs, frame by frame."""
    frames, width, end = [], rows.shape[1], bytes([extra])
    data = rows.tobytes()
    for at in range(0, len(data), width):
        frame = data[at : at + width - CRC_BYTES].rstrip(b"\0")
        frame = frame.ljust(HEAD_BYTES + 1, b"\0")
        body = bytes([len(frame) - HEAD_BYTES]) + frame[2:]
        frames.append(frame[:1] + body + mcrf4xx(body + end).to_bytes(2, "little"))
    return frames


def _finish_all(rows: Any, extra: int, table: Any, out: Any, ends: Any) -> None:
    """Do what `finish_plainly` does: write the frames one behind the other, and where each ends."""
    at, full = 0, rows.shape[1] - CRC_BYTES
    for row in range(rows.shape[0]):
        end = full
        while end > HEAD_BYTES + 1 and rows[row, end - 1] == 0:
            end -= 1
        rows[row, 1] = end - HEAD_BYTES
        crc = FIRST_CRC
        out[at] = rows[row, 0]
        for byte in range(1, end):
            value = rows[row, byte]
            out[at + byte] = value
            crc = (crc >> 8) ^ table[(crc ^ value) & 0xFF]
        crc = (crc >> 8) ^ table[(crc ^ extra) & 0xFF]
        out[at + end], out[at + end + 1] = crc & 0xFF, crc >> 8
        at += end + CRC_BYTES
        ends[row] = at


def _crc_table() -> NDArray[np.int64]:
    """Give CRC-16/MCRF4XX of every byte alone, for a register of zeros."""
    values = np.arange(256)
    for _ in range(8):
        values = np.where(values & 1, values >> 1 ^ 0x8408, values >> 1)
    return values


def _finisher() -> Finish:
    try:
        numba = importlib.import_module("numba")
    except ImportError:  # pragma: no cover - the extra `fast` is optional
        return finish_plainly
    finish_all, table = numba.njit(cache=True)(_finish_all), _crc_table()

    def finish_compiled(rows: Bytes, extra: int) -> list[bytes]:
        out, ends = np.empty(rows.size, np.uint8), np.empty(len(rows), np.int64)
        finish_all(rows, extra, table, out, ends)
        data, stops = out.tobytes(), ends.tolist()
        return [data[at:to] for at, to in zip([0, *stops], stops, strict=False)]

    return finish_compiled


finish: Finish = _finisher()
FINISHERS: Sequence[Finish] = (finish, finish_plainly)
"""What ends frames here, and what does where numba is not installed."""
