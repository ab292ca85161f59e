"""The codec against pymavlink, message by message, and against what no sender should send."""

from __future__ import annotations

import math
import struct
from collections import Counter
from statistics import median
from typing import Any

import codec
import numpy as np
import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import TABLES, random_values
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator import mavcrc

from swarm_ctl import wire
from swarm_ctl.signing import Signer
from swarm_ctl.wire import parser as parser_module

HEARTBEAT, ATTITUDE = wire.message("HEARTBEAT"), wire.message("ATTITUDE")
BEAT = (2, 12, 209, 0, 4, 3)
fuzz = settings(derandomize=True, deadline=None, max_examples=300)


def beat(seq: int = 0, sysid: int = 1) -> bytes:
    return HEARTBEAT.pack(seq, sysid, 1, *BEAT)


def foreign(number: int = 0xABCDEF, payload: bytes = b"\x01" * 20, flags: int = 0) -> bytes:
    header = struct.pack("<BBBBBBB", 0xFD, len(payload), flags, 0, 0, 1, 1)
    return header + number.to_bytes(3, "little") + payload + b"\x12\x34"


def base_counts(table: Any) -> list[int]:
    """Find the numbers of base fields that explain the CRC extra byte, which covers no others."""
    types = dict(zip(table.fieldnames, table.fieldtypes, strict=True))
    text, found = f"{table.msgname} ".encode(), []
    for i, name in enumerate(table.ordered_fieldnames):
        text += f"{types[name]} {name} ".encode()
        if table.array_lengths[i]:
            text += bytes([table.array_lengths[i]])
        crc = mcrf4xx(text)
        if (crc & 0xFF) ^ (crc >> 8) == table.crc_extra:
            found.append(i + 1)
    return found


def as_ours(value: Any, code: str, *, is_array: bool) -> Any:
    """Give pymavlink's value the type that ours has."""
    if code == "c":
        return value.decode("ascii", "replace") if isinstance(value, bytes) else value
    if is_array:
        return bytes(value) if code == "B" else tuple(value)
    return value


def pymavlink_values(frame: bytes) -> tuple[Any, ...]:
    """Decode a frame with pymavlink."""
    decoded = dialect.MAVLink(None).decode(bytearray(frame))
    codes = decoded.native_format.decode().lstrip("<")
    return tuple(
        as_ours(getattr(decoded, name), codes[i], is_array=decoded.array_lengths[i] > 0)
        for name, i in zip(decoded.fieldnames, decoded.orders, strict=True)
    )


def sender(seq: int = 7, sysid: int = 3, compid: int = 191) -> Any:
    mav = dialect.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    mav.seq = seq
    return mav


@pytest.mark.parametrize("number", TABLES)
def test_every_message_is_pymavlink_byte_for_byte(number: int) -> None:
    table, one, rng = TABLES[number], wire.message(number), np.random.default_rng(number)
    parser = wire.Parser([number])
    for _ in range(10):
        values = random_values(table, rng)
        frame = one.pack(7, 3, 191, *values)
        assert frame == table(*values).pack(sender())
        (parsed,) = parser.feed(frame)
        assert tuple(parsed) == (3, 191, 7, number, pymavlink_values(frame), frame)
        assert type(parsed.values) is one.values
        assert one.pack(7, 3, 191, *parsed.values) == frame
    assert parser.stats == wire.Stats(frames=10)


@pytest.mark.parametrize("number", [number for number in TABLES if number < 256])
def test_every_mavlink_1_frame_is_pymavlinks_without_extensions(number: int) -> None:
    table, one, rng = TABLES[number], wire.message(number), np.random.default_rng(number)
    values = random_values(table, rng)
    frame = one.pack_v1(7, 3, 191, *values)
    base = base_counts(table)[-1]
    if base == len(table.fieldnames):
        assert frame == table(*values).pack(sender(), force_mavlink1=True)
    else:
        assert one.pack_v1(7, 3, 191, *values[:base]) == frame
    (parsed,) = wire.Parser(None).feed(frame)
    assert parsed == (3, 191, 7, number, pymavlink_values(frame), frame)


def test_mavlink_1_has_no_ids_above_255() -> None:
    with pytest.raises(ValueError, match="TUNNEL has id 385"):
        wire.message("TUNNEL").pack_v1(0, 1, 1, 0, 0, 0, 0, b"")


def test_messages_are_found_by_name_and_id() -> None:
    assert wire.message("HEARTBEAT") is wire.message(0)
    assert HEARTBEAT.fields[:4] == ("type", "autopilot", "base_mode", "custom_mode")
    assert (HEARTBEAT.name, HEARTBEAT.id, HEARTBEAT.values.__name__) == (
        "HEARTBEAT",
        0,
        "HEARTBEAT",
    )
    assert HEARTBEAT.values(*BEAT)._asdict()["custom_mode"] == 0


@pytest.mark.parametrize("key", ["NO_SUCH_MESSAGE", 0xABCDEF, -1])
def test_an_unknown_message_is_named(key: str | int) -> None:
    with pytest.raises(ValueError, match=f"no message {key!r}"):
        wire.message(key)
    with pytest.raises(ValueError, match=f"no message {key!r}"):
        wire.Parser([key])


def test_trailing_zeros_are_cut_down_to_one_byte() -> None:
    frame = ATTITUDE.pack(0, 1, 1, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert len(frame) == 13
    (parsed,) = wire.Parser(["ATTITUDE"]).feed(frame)
    assert parsed.values == (0,) * 7


@pytest.mark.parametrize("payload", [b"", b"\x01", bytearray(b"\x01\x00"), b"\x01" + bytes(300)])
def test_payloads_of_any_length_unpack(payload: bytes) -> None:
    assert ATTITUDE.unpack(payload) == (1 if payload else 0, *(0.0,) * 6)


def test_extensions_may_be_left_out() -> None:
    sensor = wire.message("DISTANCE_SENSOR")
    values = sensor.unpack(sensor.pack(0, 1, 1, 9, 20, 4000, 812, 0, 3, 100, 255)[10:-2])
    assert values.current_distance == 812
    assert (values.horizontal_fov, values.quaternion, values.signal_quality) == (0.0, (0.0,) * 4, 0)


def test_text_ends_at_the_first_nul_and_never_raises() -> None:
    text = wire.message("STATUSTEXT")

    def there_and_back(value: str | bytes) -> Any:
        return wire.Parser([text]).feed(text.pack(0, 1, 1, 6, value))[0].values.text

    assert there_and_back("take-off") == there_and_back(b"take-off\0xyz") == "take-off"
    assert there_and_back("caf\u00e9") == "caf?"
    assert there_and_back(b"\xff\xfe") == "\ufffd\ufffd"
    assert there_and_back("x" * 60) == "x" * 50


@pytest.mark.parametrize(
    "payload",
    [b"\x01\x02", bytearray(b"\x01\x02"), (1, 2), [1, 2], np.array([1, 2]), memoryview(b"\1\2")],
)
def test_bytes_are_padded(payload: Any) -> None:
    tunnel = wire.message("TUNNEL")
    frame = tunnel.pack(0, 1, 191, 0, 0, 40417, 2, payload)
    (parsed,) = wire.Parser(["TUNNEL"]).feed(frame)
    assert parsed.values.payload == b"\x01\x02" + bytes(126)


@pytest.mark.parametrize("voltages", [(1, 2), [1, 2], np.array([1, 2], dtype=np.uint16)])
def test_arrays_are_padded(voltages: Any) -> None:
    battery = wire.message("BATTERY_STATUS")
    frame = battery.pack(0, 1, 1, 0, 0, 0, 0, voltages, 0, 0, 0, 0)
    (parsed,) = wire.Parser(["BATTERY_STATUS"]).feed(frame)
    assert parsed.values.voltages == (1, 2, *(0,) * 8)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nan_and_infinities_survive(value: float) -> None:
    command = wire.message("COMMAND_LONG")
    frame = command.pack(0, 1, 1, 1, 1, 511, 0, *(value,) * 7)
    (parsed,) = wire.Parser([command]).feed(frame)
    assert [str(param) for param in parsed.values[4:]] == [str(value)] * 7


@pytest.mark.parametrize(
    ("name", "values", "field"),
    [
        ("HEARTBEAT", (2, 12, 256, 0, 4, 3), "base_mode"),
        ("HEARTBEAT", (2, -1, 0, 0, 4, 3), "autopilot"),
        ("HEARTBEAT", (2, 12, 1.5, 0, 4, 3), "base_mode"),
        ("ATTITUDE", (1, 1e39, 0.0, 0.0, 0.0, 0.0, 0.0), "roll"),
        ("ATTITUDE", (1, 0.0, None, 0.0, 0.0, 0.0, 0.0), "pitch"),
        ("STATUSTEXT", (6, 5), "text"),
        ("TUNNEL", (0, 0, 0, 129, bytes(129)), "payload"),
        ("TUNNEL", (0, 0, 0, 129, [256]), "payload"),
        ("TUNNEL", (0, 0, 0, 129, 5), "payload"),
        ("BATTERY_STATUS", (0, 0, 0, 0, (1,) * 11, 0, 0, 0, 0), "voltages"),
        ("BATTERY_STATUS", (0, 0, 0, 0, (1, "x"), 0, 0, 0, 0), "voltages"),
        ("BATTERY_STATUS", (0, 0, 0, 0, None, 0, 0, 0, 0), "voltages"),
    ],
)
def test_a_value_that_does_not_fit_is_named(name: str, values: Any, field: str) -> None:
    one = wire.message(name)
    for pack in [one.pack, one.pack_v1] if one.id < 256 else [one.pack]:
        with pytest.raises(ValueError, match=f"^{name}.{field} cannot be"):
            pack(0, 1, 1, *values)


def test_a_header_that_does_not_fit_is_named() -> None:
    with pytest.raises(ValueError, match=r"^HEARTBEAT\.seq cannot be 256"):
        HEARTBEAT.pack(256, 1, 1, *BEAT)


def test_a_datagram_may_hold_several_frames() -> None:
    frames = [beat(0), ATTITUDE.pack(1, 1, 1, *range(7)), HEARTBEAT.pack_v1(2, 1, 1, *BEAT)]
    parser = wire.Parser(["HEARTBEAT"])
    parsed = parser.feed(b"".join(frames))
    assert [frame.raw for frame in parsed] == [frames[0], frames[2]]
    assert parser.stats == wire.Stats(frames=3)
    assert list(wire.split(b"".join(frames))) == frames


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
@pytest.mark.parametrize("size", [1, 2, 3, 7, 11, 12, 13, 50])
def test_frames_may_be_split_over_feeds(size: int, kind: Any) -> None:
    short_v1 = wire.message("MISSION_REQUEST_LIST").pack_v1(1, 1, 1, 1, 1)
    stream = (beat(0) + short_v1 + foreign() + beat(2) + foreign(flags=2) + beat(3)) * 3
    parser = wire.Parser(None)
    chunks = [kind(stream[at : at + size]) for at in range(0, len(stream), size)]
    parsed = [frame for chunk in chunks for frame in parser.feed(chunk)]
    assert b"".join(frame.raw for frame in parsed) == (beat(0) + short_v1 + beat(2) + beat(3)) * 3
    assert (parser.stats.frames, parser.stats.unknown, parser.stats.bad_flags) == (12, 3, 3)
    assert parser.stats.bad_crc == parser.stats.skipped_bytes == 0


def test_a_bad_crc_does_not_take_the_next_frame_with_it() -> None:
    for position in range(10, len(beat())):
        broken = bytearray(beat(0))
        broken[position] ^= 0x10
        parser = wire.Parser(["HEARTBEAT"])
        assert [frame.seq for frame in parser.feed(bytes(broken) + beat(1))] == [1]
        assert parser.stats == wire.Stats(frames=1, bad_crc=1, skipped_bytes=len(broken))


def test_an_unsubscribed_frame_is_checked_as_well() -> None:
    parser = wire.Parser([])
    assert parser.feed(beat(0) + beat(1)[:-1] + b"\x00") == []
    assert (parser.stats.frames, parser.stats.bad_crc) == (1, 1)


@pytest.mark.parametrize("wanted", [None, [44, 300], [300], []])
@pytest.mark.parametrize("is_joined", [True, False])
def test_ids_that_end_alike_are_told_apart(wanted: list[int] | None, *, is_joined: bool) -> None:
    count, version = wire.message(44), wire.message(300)
    frames = [
        *(count.pack(seq, 1, 1, 1, 1, 7, 0) for seq in (0, 2, 4)),
        *(version.pack(seq, 1, 1, 200, 100, 203, b"\1" * 8, b"\2" * 8) for seq in (1, 3, 5)),
    ]
    frames.sort(key=lambda frame: frame[4])
    parser = wire.Parser(wanted)
    chunks = [b"".join(frames)] if is_joined else frames
    parsed = [frame for chunk in chunks for frame in parser.feed(chunk)]
    expected = [44, 300] * 3
    assert [frame.id for frame in parsed] == [
        number for number in expected if wanted is None or number in wanted
    ]
    assert parser.stats == wire.Stats(frames=6)


def test_ids_that_end_alike_and_have_one_crc_extra_are_told_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parser_module, "_NAMED", Counter())
    parser = wire.Parser(None)
    assert [frame.seq for seq in range(3) for frame in parser.feed(beat(seq))] == [0, 1, 2]
    assert parser.stats == wire.Stats(frames=3)


@pytest.mark.parametrize("magic", [0x00, 0xFC, 0xFF])
def test_another_magic_is_no_frame(magic: int) -> None:
    parser = wire.Parser(None)
    parser.feed(beat(0))
    assert parser.feed(bytes([magic]) + beat(1)[1:]) == []
    assert [frame.seq for frame in parser.feed(beat(1))] == [1]
    assert parser.stats.frames == 2


def test_unknown_ids_are_stepped_over() -> None:
    parser = wire.Parser(None)
    hidden = foreign(payload=beat(9))
    assert [frame.seq for frame in parser.feed(hidden + beat(1) + hidden)] == [1]
    assert parser.stats == wire.Stats(frames=1, unknown=2)


def test_unknown_flags_are_dropped_whatever_the_crc() -> None:
    flagged = bytearray(beat(0))
    flagged[2] = 0x02
    flagged[-2:] = struct.pack("<H", mcrf4xx(bytes(flagged[1:-2]) + b"\x32"))
    parser = wire.Parser(None)
    assert [frame.seq for frame in parser.feed(bytes(flagged) + beat(1))] == [1]
    assert parser.stats == wire.Stats(frames=1, bad_flags=1)


def test_a_signature_is_stepped_over() -> None:
    mav = sender()
    mav.signing.secret_key, mav.signing.sign_outgoing = bytes(32), True
    signed = TABLES[0](*BEAT).pack(mav)
    assert len(signed) == len(beat()) + 13
    parser = wire.Parser(None)
    parsed = parser.feed(signed + beat(8, sysid=3) + signed[:-5])
    assert [(frame.values, frame.seq) for frame in parsed] == [(BEAT, 7), (BEAT, 8)]
    assert parsed[0].raw == signed
    assert list(wire.split(signed + beat())) == [signed, beat()]
    assert [frame.raw for frame in parser.feed(signed[-5:])] == [signed]


@given(st.binary(max_size=60), st.booleans())
def test_known_frames_are_read_like_the_first_of_their_id(payload: bytes, is_signed: bool) -> None:
    known = wire.message("DISTANCE_SENSOR")
    values, parser = known.unpack(payload), wire.Parser([known])
    frame = known.pack(1, 1, 1, *values)
    if is_signed:
        frame = Signer(bytes(32)).sign(frame)
    first, second, third = [*parser.feed(frame * 2), *parser.feed(frame)]
    assert repr(first) == repr(second) == repr(third), "NaN is not itself"
    assert parser.stats == wire.Stats(frames=3)
    assert repr(first.values) == repr(values)


def test_a_signature_that_has_not_come_yet_is_waited_for() -> None:
    parser = wire.Parser(None)
    for seq in range(2):  # the first of its id goes another way
        signed = Signer(bytes(32)).sign(beat(seq))
        assert parser.feed(signed[:-13]) == []
        assert [frame.raw for frame in parser.feed(signed[-13:])] == [signed]


def test_garbage_is_skipped() -> None:
    parser = wire.Parser(None)
    garbage = b"\x00garbage\xff"
    assert [
        frame.seq for frame in parser.feed(garbage + beat(1) + garbage + beat(2) + garbage)
    ] == [1, 2]
    assert parser.stats == wire.Stats(frames=2, skipped_bytes=3 * len(garbage))
    assert list(wire.split(garbage + beat(1) + garbage + beat(2) + b"\xfd")) == [beat(1), beat(2)]


def test_a_made_up_length_does_not_take_good_frames_with_it() -> None:
    parser = wire.Parser(["HEARTBEAT"])
    made_up = foreign(payload=bytes(30))[:12]
    assert [frame.seq for frame in parser.feed(made_up + b"".join(map(beat, range(10))))] == [
        *range(10)
    ]
    assert parser.stats.skipped_bytes == len(made_up)


@pytest.mark.parametrize("number", [0, 0xABCDEF])
def test_a_frame_that_never_ends_gives_way_to_the_next_datagram(number: int) -> None:
    parser = wire.Parser(["HEARTBEAT"])
    assert parser.feed(foreign(number, payload=b"\x01" * 255)[:40]) == []
    assert [frame.seq for frame in parser.feed(beat(1))] == [1]
    assert parser.stats == wire.Stats(frames=1, skipped_bytes=40)


def test_frames_that_never_end_one_inside_the_other_give_way_to_the_next_datagram() -> None:
    parser = wire.Parser(["HEARTBEAT"])
    nested = b"\xfe\x1e" + bytes(4) + b"\xfe\xfe" + bytes(14)
    assert parser.feed(nested) == []
    assert [frame.seq for seq in range(4) for frame in parser.feed(beat(seq))] == [0, 1, 2, 3]
    assert parser.stats.skipped_bytes == len(nested)


@pytest.mark.parametrize(
    ("seqs", "lost"),
    [
        ([200], 0),
        ([254, 255, 0, 1], 0),
        ([250, 5], 10),
        ([0, 2, 4], 2),
        ([0, 127], 126),
        ([7, 7, 7, 8], 0),
        ([10, 12, 11, 13], 1),
    ],
)
def test_lost_frames_are_counted_by_sequence(seqs: list[int], lost: int) -> None:
    parser = wire.Parser([])
    for seq in seqs:
        parser.feed(beat(seq) + beat(0, sysid=9))
    assert parser.stats.lost == lost


def test_losses_are_known_per_system() -> None:
    parser = wire.Parser([])
    for frame in (beat(0), HEARTBEAT.pack(0, 1, 191, *BEAT), beat(0, sysid=9)):
        parser.feed(frame)
    parser.feed(beat(3) + HEARTBEAT.pack(2, 1, 191, *BEAT) + beat(11, sysid=9))
    assert [parser.lost_of(sysid) for sysid in (1, 9, 2)] == [3, 10, 0]
    assert parser.stats.lost == 13


def test_payloads_longer_than_ours_lose_what_we_do_not_know() -> None:
    body = beat(5)[2:10] + struct.pack("<IBBBBB", 7, 2, 12, 209, 4, 3) + b"\x09\x09"
    body = bytes([11]) + body
    longer = b"\xfd" + body + struct.pack("<H", mcrf4xx(body + b"\x32"))
    parser = wire.Parser(["HEARTBEAT"])
    (parsed,) = parser.feed(longer)
    assert parsed == (1, 1, 5, 0, (2, 12, 209, 7, 4, 3), longer)
    assert [frame.seq for frame in parser.feed(longer + beat(6))] == [5, 6]
    assert parser.stats == wire.Stats(frames=3)


def test_unknown_frames_are_no_loss() -> None:
    parser = wire.Parser([])
    unknown = bytearray(foreign())
    unknown[4] = 1
    parser.feed(beat(0) + unknown + beat(2))
    assert parser.stats == wire.Stats(frames=2, unknown=1)


def assert_sane(parser: wire.Parser, chunks: list[bytes]) -> list[wire.Frame]:
    """Feed chunks, and check what holds whatever they are."""
    frames, fed, stats = [], 0, parser.stats
    for chunk in chunks:
        frames += parser.feed(chunk)
        fed += len(chunk)
        used = sum(len(frame.raw) for frame in frames) + stats.skipped_bytes + len(parser._rest)
        assert len(parser._rest) < 280
        assert stats.frames == len(frames)
        assert (
            fed - used
            >= 12 * (stats.unknown + stats.bad_flags) - 4 * stats.unknown - used * 0 - fed
        )
        if not stats.unknown + stats.bad_flags:
            assert used == fed
        assert used <= fed
    return frames


STREAM = b"".join(beat(seq) + ATTITUDE.pack(seq, 2, 1, *range(7)) for seq in range(4)) + foreign()
MAGICAL = st.lists(st.sampled_from([0xFD, 0xFE, 0, 1, 2, 9, 30, 255]), max_size=400).map(bytes)


@fuzz
@given(st.lists(st.binary(max_size=400) | MAGICAL, max_size=6))
def test_any_bytes_are_swallowed(chunks: list[bytes]) -> None:
    assert_sane(wire.Parser(None), chunks)
    stream = b"".join(chunks)
    assert all(frame in stream and frame[0] in b"\xfd\xfe" for frame in wire.split(stream))


@fuzz
@given(
    st.lists(st.tuples(st.integers(0, len(STREAM) - 1), st.integers(0, 255)), max_size=8),
    st.integers(1, 300),
)
def test_mutated_frames_are_refused_and_the_others_come(
    mutations: list[tuple[int, int]], size: int
) -> None:
    stream = bytearray(STREAM)
    for position, value in mutations:
        stream[position] = value
    chunks = [bytes(stream[at : at + size]) for at in range(0, len(stream), size)]
    parser = wire.Parser(None)
    frames = assert_sane(parser, [*chunks, *[beat(99, sysid=7)] * 20])
    good = {frame for frame in wire.split(STREAM) if frame != foreign()} | {beat(99, sysid=7)}
    assert {frame.raw for frame in frames} <= good
    assert beat(99, sysid=7) in {frame.raw for frame in frames}


@fuzz
@given(st.integers(0, len(TABLES) - 1), st.binary(max_size=255))
def test_any_payload_decodes(index: int, payload: bytes) -> None:
    one = wire.message([*TABLES][index])
    assert len(one.unpack(payload)) == len(one.fields)


def test_it_is_far_faster_than_pymavlink() -> None:
    packs, parses = [], []
    for _ in range(7):
        rows = [codec.measure(name, repeats=5) for name in codec.HOT]
        packs.append(sum(row.pymavlink_pack_us for row in rows) / sum(row.pack_us for row in rows))
        parses.append(
            sum(row.pymavlink_parse_us for row in rows) / sum(row.parse_us for row in rows)
        )
    assert median(packs) >= 5.0
    assert median(parses) >= 5.0


def test_protocol_version_is_what_its_definition_says() -> None:
    definition = "PROTOCOL_VERSION "  # mavlink.io/en/messages/common.html#PROTOCOL_VERSION
    x25crc: Any = mavcrc.x25crc
    crc = x25crc()
    for kind, name, length in (
        ("uint16_t", "version", 0),
        ("uint16_t", "min_version", 0),
        ("uint16_t", "max_version", 0),
        ("uint8_t", "spec_version_hash", 8),
        ("uint8_t", "library_version_hash", 8),
    ):
        definition += f"{kind} {name} " + (chr(length) if length else "")
    crc.accumulate_str(definition)
    frame = wire.message("PROTOCOL_VERSION").pack(5, 1, 1, 200, 100, 203, b"", bytes(7) + b"7")
    assert frame[:10] == bytes([0xFD, 22, 0, 0, 5, 1, 1, 300 & 0xFF, 300 >> 8, 0])
    check = x25crc(frame[1:-2])
    check.accumulate([(crc.crc & 0xFF) ^ (crc.crc >> 8)])
    assert frame[-2:] == check.crc.to_bytes(2, "little")
    (heard,) = wire.Parser(["PROTOCOL_VERSION"]).feed(frame)
    assert heard.values[:3] == (200, 100, 203)
