"""Payloads and addresses of the bus."""

from __future__ import annotations

import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.bus.embedded import embedded_broker, embedded_port
from swarm_ctl.bus.messages import (
    MOST_BYTES,
    Ack,
    Coverage,
    Event,
    Info,
    Order,
    State,
    Status,
    ack_topic,
    order_topic,
    read,
    topic,
)
from swarm_ctl.bus.mqtt import PASSWORD_VARIABLE, Broker, in_words
from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Operator


@pytest.mark.parametrize("operator", Operator)
def test_an_order_is_read_as_it_was_written(operator: Operator) -> None:
    assert Order.load(Order(operator, "b7").dump()) == Order(operator, "b7")


@pytest.mark.parametrize(
    "payload",
    [b"land", b" land\n", b'{"order": "land"}', b'\n{"order":"land","id":"","sender":"me"} '],
)
def test_a_word_and_json_say_the_same(payload: bytes) -> None:
    assert Order.load(payload) == Order(Operator.LAND)


@pytest.mark.parametrize(
    ("payload", "id_", "words"),
    [
        (b"", "", "none of start, pause, resume, return, land, abort"),
        (b"explode", "", "none of"),
        (b"LAND", "", "none of"),
        (b'{"order": "explode", "id": "7"}', "7", "none of"),
        (b'{"id": "7"}', "7", "none of"),
        (b'{"order": ["land"]}', "", "none of"),
        (b'{"order": null}', "", "none of"),
        (b'{"order": "land", "id": 7}', "", "its id is no text"),
        (b'{"order": "land", "id": "%s"}' % (b"7" * 101), "", "its id is no text"),
        (b'{"order": "land"', "", "neither JSON nor a word"),
        (b"\xff\xfe", "", "neither JSON nor a word"),
        (b'{"order":' + b"[" * 900, "", "neither JSON nor a word"),
        (b'["land"]', "", "none of"),
        (b"land" + b" " * MOST_BYTES, "", "longer than 1000 bytes"),
    ],
)
def test_what_is_no_order_says_why(payload: bytes, id_: str, words: str) -> None:
    order = Order.load(payload)
    assert (order.operator, order.id) == (None, id_)
    assert words in order.error


@given(st.binary(max_size=200) | st.recursive(st.text(), st.lists).map(json.dumps).map(str.encode))
def test_whatever_comes_is_an_order_or_says_why_not(payload: bytes) -> None:
    for said in (
        payload,
        b'{"order": ' + payload + b"}",
        b'{"order":"land","id":' + payload + b"}",
    ):
        order = Order.load(said)
        assert (order.operator is None) == bool(order.error)
        Ack.load(said)


def test_an_acknowledgement_is_read_as_it_was_written() -> None:
    ack = Ack("b7", "land", accepted=True, phase="landing", time_s=12.5)
    assert Ack.load(ack.dump()) == ack
    assert json.loads(ack.dump()) == {
        "v": 1,
        "id": "b7",
        "order": "land",
        "accepted": True,
        "phase": "landing",
        "time_s": 12.5,
        "error": "",
    }
    assert Ack.load(b"{}") is Ack.load(b"[1]") is Ack.load(b"\xff") is None


def test_topics_are_those_of_the_manual() -> None:
    assert order_topic("hall") == "swarm/hall/order"
    assert order_topic("hall", 3) == "swarm/hall/3/order"
    assert ack_topic("hall", 3) == "swarm/hall/3/ack"
    assert ack_topic("hall") == "swarm/hall/+/ack"


@pytest.mark.parametrize(
    ("url", "host", "port", "user", "password"),
    [
        ("mqtt://broker", "broker", 1883, None, None),
        ("mqtt://broker:1884/", "broker", 1884, None, None),
        ("mqtts://broker", "broker", 8883, None, None),
        ("mqtt://[::1]:1883", "::1", 1883, None, None),
        ("mqtt://ann@broker", "broker", 1883, "ann", None),
        ("mqtt://ann:a%40b:c@broker", "broker", 1883, "ann", "a@b:c"),
    ],
)
def test_an_address_says_who_enters_where(
    url: str, host: str, port: int, user: str | None, password: str | None
) -> None:
    broker = Broker.parse(url, {})
    assert (broker.host, broker.port) == (host, port)
    assert (broker.user, broker.password) == (user, password)
    assert (broker.tls is not None) == url.startswith("mqtts")


def test_the_password_in_the_environment_wins_and_none_is_ever_shown() -> None:
    broker = Broker.parse("mqtt://ann:visible@broker", {PASSWORD_VARIABLE: "hidden"})
    assert broker.password == "hidden"  # noqa: S105 - the test's own
    assert str(broker) == "mqtt://broker:1883"
    assert str(Broker.parse("mqtts://[::1]", {})) == "mqtts://[::1]:8883"
    assert "hidden" not in repr(broker)


@pytest.mark.parametrize(
    "url",
    [
        *("", "broker", "broker:1883", "http://broker", "mqtt://", "mqtt://:1883", "mqtt://ann@"),
        *("mqtt://broker:0x1", "mqtt://broker:99999", "mqtt://broker/topic", "mqtt://a..b"),
        *("mqtt://ann:secret@broker/topic", "mqtt://[::1", "mqtt://" + "a" * 70),
    ],
)
def test_a_wrong_address_is_one_sentence_without_the_password(url: str) -> None:
    with pytest.raises(SwarmError, match=r"^--mqtt: expected mqtt://") as refused:
        Broker.parse(url, {})
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize(
    ("url", "port"),
    [("embedded", 1883), ("embedded:18830", 18830), ("mqtt://embedded", None), ("embed", None)],
)
def test_a_broker_in_the_process_is_named_by_its_port(url: str, port: int | None) -> None:
    assert embedded_port(url) == port


@pytest.mark.parametrize("port", [0, 65536, 999_999_999])
def test_a_port_that_is_none_is_one_sentence(port: int) -> None:
    with pytest.raises(SwarmError, match=f"^--mqtt embedded:{port}: expected a port from 1 to"):
        embedded_port(f"embedded:{port}")


def test_without_its_extra_the_embedded_broker_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "amqtt.broker", None)
    expected = r"^--mqtt embedded: needs amqtt.*missing: pip install 'swarm-ctl\[broker\]'$"
    with pytest.raises(SwarmError, match=expected), embedded_broker(1883):
        pass


def test_a_reason_is_one_line() -> None:
    nested = ExceptionGroup("many", [ExceptionGroup("more", [OSError("no\n  way")])])
    assert in_words(nested) == "no way"
    assert in_words(TimeoutError()) == "TimeoutError"


# -- what is told --------------------------------------------------------------------------------

PAGE = (Path(__file__).parents[2] / "docs" / "bus.md").read_text()
EXAMPLES = [json.loads(block) for block in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)]
STATUS = Status("2026-11-22T09:00:00+00:00", 3, "online")
COVERAGE = Coverage("2026-11-22T09:00:00+00:00", 3, 7, 12.5, 0.2, [[1, -2, 3]])


@pytest.mark.parametrize("kind", [Info, Status, State, Event, Coverage])
def test_the_page_shows_every_payload_with_all_its_keys(
    kind: type[Info | Status | State | Event | Coverage],
) -> None:
    (example,) = (e for e in EXAMPLES if e.keys() == {"v", *kind.__slots__})
    told = kind.load(json.dumps(example).encode())
    assert told is not None
    assert json.loads(told.dump()) == example


def test_what_is_told_is_known_by_its_topic() -> None:
    assert read("swarm/hall/3/status", STATUS.dump()) == STATUS
    assert read("swarm/hall/3/coverage", COVERAGE.dump()) == COVERAGE
    assert read("swarm/hall/3/coverage/all", COVERAGE.dump()) == COVERAGE
    assert read("swarm/hall/3/state", STATUS.dump()) is None
    for elsewhere in ("swarm/hall/order", "swarm/hall/3/ack", "swarm", "", "swarm/hall/3/event"):
        assert read(elsewhere, STATUS.dump()) is None
    assert topic("hall", 3, "status") == "swarm/hall/3/status"


def test_keys_that_are_new_are_left_out_and_another_version_is_not_read() -> None:
    said = json.loads(STATUS.dump())
    assert Status.load(json.dumps({**said, "colour": "red"}).encode()) == STATUS
    assert Status.load(json.dumps({**said, "v": 2}).encode()) is None


@pytest.mark.parametrize(
    "change",
    [
        {"time_s": "soon"},
        {"time_s": True},
        {"time_s": math.nan},
        {"number": 1.5},
        {"rows": {}},
        {"rows": [[1, 2, None]]},
        {"run": None},
    ],
)
def test_a_key_of_another_type_is_not_read(change: dict[str, object]) -> None:
    said = {**json.loads(COVERAGE.dump()), **change}
    assert Coverage.load(json.dumps(said).encode()) is None


def test_a_number_that_is_none_is_told_as_nobody_knows() -> None:
    (example,) = (e for e in EXAMPLES if "ranges_m" in e)
    state = State.load(json.dumps(example).encode())
    assert state is not None
    strange = replace(state, link_age_s=math.inf, ranges_m=[math.inf, math.nan, 1.0])
    told = State.load(strange.dump())
    assert told is not None
    assert (told.link_age_s, told.ranges_m) == (None, [None, None, 1.0])


@given(st.binary(max_size=200) | st.recursive(st.text(), st.lists).map(json.dumps).map(str.encode))
def test_whatever_is_told_is_read_or_left(payload: bytes) -> None:
    for leaf in ("status", "state", "event/1", "coverage"):
        read(f"swarm/hall/3/{leaf}", payload)
