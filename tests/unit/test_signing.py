from __future__ import annotations

from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from messages import TABLES, random_values
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl import wire
from swarm_ctl.signing import (
    KEY_VARIABLE,
    LATEST,
    UNITS_1_S,
    Gatekeeper,
    Signer,
    Verdict,
    find_key,
    key_of,
    timestamp_of,
)

KEY = key_of("swarm")
NOW = timestamp_of(datetime(2026, 3, 1, tzinfo=UTC))
HEARTBEAT = wire.message("HEARTBEAT")


def pymavlink(key: bytes = KEY, *, timestamp: int = NOW, link_id: int = 0, sysid: int = 3) -> Any:
    """Give pymavlink's codec, which signs and checks."""
    mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=191)
    mav.signing.secret_key, mav.signing.link_id = key, link_id
    mav.signing.timestamp, mav.signing.sign_outgoing = timestamp, True
    return mav


def heartbeat(mav: Any) -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(mav))


def plain(seq: int = 0) -> bytes:
    return HEARTBEAT.pack(seq, 3, 191, 18, 8, 0, 0, 4, 3)


@pytest.mark.parametrize("number", TABLES)
def test_pymavlink_signs_every_message_byte_for_byte_alike(number: int) -> None:
    table, rng = TABLES[number], np.random.default_rng(number)
    mav, signer = pymavlink(link_id=5), Signer(KEY, NOW)
    for seq in range(4):
        values = random_values(table, rng)
        signed = signer.sign(wire.message(number).pack(seq, 3, 191, *values), link_id=5)
        mav.seq, mav.signing.timestamp = seq, signer.timestamp
        assert signed == bytes(table(*values).pack(mav))


@pytest.mark.parametrize("number", TABLES)
def test_signed_frames_of_every_message_are_read_as_unsigned_ones(number: int) -> None:
    table, rng = TABLES[number], np.random.default_rng(number)
    frame = wire.message(number).pack(0, 3, 191, *random_values(table, rng))
    signed = Signer(KEY, NOW).sign(frame)
    (read,) = wire.Parser([number]).feed(frame)
    (read_signed,) = wire.Parser([number]).feed(signed)
    assert read_signed == read._replace(raw=signed)
    assert Signer(KEY, NOW).verify(read_signed.raw) is Verdict.ACCEPTED


def test_pymavlink_accepts_what_we_sign() -> None:
    mav, signer = pymavlink(), Signer(KEY, NOW)
    for seq in range(20):
        (message,) = mav.parse_buffer(signer.sign(plain(seq)))
        assert message.get_signed()
    assert mav.signing.goodsig_count == 20


def test_we_accept_what_pymavlink_signs() -> None:
    mav, signer = pymavlink(), Signer(KEY, NOW)
    assert [signer.verify(heartbeat(mav)) for _ in range(20)] == [Verdict.ACCEPTED] * 20


def test_a_frame_is_accepted_once() -> None:
    mav, signer = pymavlink(), Signer(KEY, NOW)
    first, second = heartbeat(mav), heartbeat(mav)
    assert signer.verify(second) is Verdict.ACCEPTED
    assert signer.verify(second) is Verdict.REPLAYED
    assert signer.verify(first) is Verdict.REPLAYED
    assert signer.verify(heartbeat(mav)) is Verdict.ACCEPTED


def test_each_stream_has_its_own_time() -> None:
    signer = Signer(KEY, NOW)
    assert signer.verify(heartbeat(pymavlink(timestamp=NOW + 100))) is Verdict.ACCEPTED
    assert signer.verify(heartbeat(pymavlink(link_id=1))) is Verdict.ACCEPTED
    assert signer.verify(heartbeat(pymavlink(sysid=4))) is Verdict.ACCEPTED
    assert signer.verify(heartbeat(pymavlink())) is Verdict.REPLAYED


def test_a_new_stream_may_be_a_minute_behind_and_no_more() -> None:
    late = NOW - 60 * UNITS_1_S
    assert Signer(KEY, NOW).verify(heartbeat(pymavlink(timestamp=late))) is Verdict.ACCEPTED
    assert Signer(KEY, NOW).verify(heartbeat(pymavlink(timestamp=late - 1))) is Verdict.OLD
    theirs = pymavlink()
    assert not theirs.check_signature(bytearray(heartbeat(pymavlink(timestamp=late - 1))), 3, 191)


def test_another_key_forges() -> None:
    assert Signer(KEY, NOW).verify(heartbeat(pymavlink(key_of("other")))) is Verdict.FORGED


@given(at=st.integers(1, 33), bit=st.integers(0, 7))
def test_a_frame_changed_on_its_way_is_never_accepted(at: int, bit: int) -> None:
    frame = bytearray(Signer(KEY, NOW).sign(plain()))
    frame[at] ^= 1 << bit
    assert Signer(KEY, NOW).verify(bytes(frame)) in {Verdict.FORGED, Verdict.UNSIGNED}


def test_a_forged_frame_from_the_future_does_not_silence_its_stream() -> None:
    signer = Signer(KEY, NOW)
    signer.verify(heartbeat(pymavlink(key_of("other"), timestamp=LATEST - 1)))
    assert signer.verify(heartbeat(pymavlink())) is Verdict.ACCEPTED


def test_plain_frames_and_mavlink_1_are_unsigned() -> None:
    signer = Signer(KEY)
    assert signer.verify(plain()) is Verdict.UNSIGNED
    assert signer.verify(HEARTBEAT.pack_v1(0, 3, 191, 18, 8, 0, 0, 4, 3)) is Verdict.UNSIGNED


@given(raw=st.binary(max_size=300))
def test_whatever_bytes_come_are_refused_and_nothing_raises(raw: bytes) -> None:
    signer = Signer(KEY)
    refused = {Verdict.UNSIGNED, Verdict.FORGED}
    assert signer.verify(raw) in refused
    assert signer.verify(b"\xfd" + bytes([len(raw) & 0xFF]) + b"\x01" + raw) in refused


@given(moments=st.lists(st.floats(0.0, 1e6), min_size=2, max_size=20))
def test_no_two_frames_share_a_timestamp_whatever_the_clock_does(moments: list[float]) -> None:
    signer, receiver = Signer(KEY, NOW), Signer(KEY)
    for now in moments:
        signer.advance(now)
        assert receiver.verify(signer.sign(plain())) is Verdict.ACCEPTED


def test_timestamps_follow_the_clock_and_the_newest_frame_heard() -> None:
    signer = Signer(KEY, NOW)
    signer.advance(2.0)
    assert signer.timestamp == NOW + 2 * UNITS_1_S
    signer.verify(heartbeat(pymavlink(timestamp=NOW + 9 * UNITS_1_S)))
    signer.advance(2.1)
    signer.sign(plain())
    assert signer.timestamp == NOW + 9 * UNITS_1_S + 1


def test_time_ends_without_an_error() -> None:
    signer = Signer(KEY)
    assert signer.verify(heartbeat(pymavlink(timestamp=LATEST - 1))) is Verdict.ACCEPTED
    signer.advance(1e12)
    for _ in range(3):
        signer.sign(plain())
    assert signer.timestamp == LATEST


def test_timestamps_count_ten_microseconds_since_2015() -> None:
    assert timestamp_of(datetime(2015, 1, 1, tzinfo=UTC)) == 0
    assert timestamp_of(datetime(2015, 1, 1, tzinfo=UTC) + timedelta(microseconds=30)) == 3


def test_a_radio_needs_no_key() -> None:
    gate = Gatekeeper()
    gate.take_key(KEY, NOW)
    status = wire.message("RADIO_STATUS").pack(0, 51, 68, 200, 190, 100, 30, 40, 0, 0)
    beat, radio = wire.Parser(None).feed(plain() + status)
    assert gate.refusal(radio) is None
    assert gate.refusal(beat) is Verdict.UNSIGNED
    assert gate.refused == {Verdict.UNSIGNED: 1}


def test_zeros_open_the_gate() -> None:
    gate = Gatekeeper()
    gate.take_key(KEY, NOW)
    gate.take_key(bytes(32), 0)
    (beat,) = wire.Parser(None).feed(plain())
    assert gate.refusal(beat) is None
    assert gate.seal(plain()) == plain()


def test_a_key_has_32_bytes() -> None:
    with pytest.raises(ValueError, match="32 bytes, not 31"):
        Signer(KEY[:31])


def test_a_passphrase_is_hashed_and_64_hexadecimal_digits_are_the_key(tmp_path: Path) -> None:
    digits = KEY.hex()
    assert key_of("swarm\n") == sha256(b"swarm").digest()
    assert key_of(digits) == key_of(digits.upper()) == KEY
    assert key_of(digits[:-1]) == sha256(digits[:-1].encode()).digest()
    file = tmp_path / "key"
    file.write_text("swarm\n")
    assert find_key(file, {KEY_VARIABLE: "other"}) == KEY
    assert find_key(None, {KEY_VARIABLE: "swarm"}) == KEY
    assert find_key(None, {}) is None


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "a key is one line"),
        (b" \n", "a key is one line"),
        (b"one\ntwo\n", "a key is one line"),
        (b"\xff\xfe\x00", "it is no text"),
        (None, "No such file"),
    ],
)
def test_a_bad_key_file_is_one_sentence_without_the_secret(
    tmp_path: Path, content: bytes | None, complaint: str
) -> None:
    file = tmp_path / "key"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ValueError, match=rf"^signing key {file}: .*{complaint}") as caught:
        find_key(file, {})
    assert "\n" not in str(caught.value)
    assert "two" not in str(caught.value)


def test_a_bad_key_in_the_environment_names_its_variable() -> None:
    with pytest.raises(ValueError, match=f"^{KEY_VARIABLE}: a key is one line"):
        find_key(None, {KEY_VARIABLE: ""})
