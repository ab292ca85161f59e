"""Frames of a whole fleet at once, against the encoder of single frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from messages import TABLES, random_values

from swarm_ctl import wire
from swarm_ctl.wire import batch
from swarm_ctl.wire.batch import FINISHERS, Batch

SYSIDS = np.array([1, 7, 255])
NUMBERS = st.one_of(st.integers(-3, 300), st.sampled_from([-(1 << 31), 1 << 16, 1 << 32, 1 << 63]))


@pytest.fixture(params=FINISHERS, ids=["as installed", "plainly"])
def finish(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "finish", request.param)


def column(code: str, length: int, values: list[Any]) -> Any:
    """Make a column of the wire's own type."""
    return np.array(values, f"S{length}" if code == "c" else f"<{code}")


@pytest.mark.usefixtures("finish")
@pytest.mark.parametrize("number", sorted(TABLES), ids=lambda n: TABLES[n].msgname)
def test_a_fleet_s_frames_are_those_of_single_vehicles(number: int) -> None:
    rng, table, message = np.random.default_rng(number), TABLES[number], wire.message(number)
    fleet = Batch(message, SYSIDS, 191)
    for seq in (0, 254, 3):
        rows = [random_values(table, rng) for _ in SYSIDS]
        columns = [
            column(field.code, field.length, list(values))
            for field, values in zip(message.declared, zip(*rows, strict=True), strict=True)
        ]
        seqs = np.arange(seq, seq + 3) & 0xFF
        single = [
            message.pack(int(s), int(sysid), 191, *row)
            for s, sysid, row in zip(seqs, SYSIDS, rows, strict=True)
        ]
        assert fleet.pack(seqs, *columns) == single


def outcome(make: Callable[[], list[bytes]]) -> list[bytes] | str:
    """Give the frames, or the field that is blamed."""
    try:
        return make()
    except ValueError as error:
        return str(error).split()[0].rstrip(":")


@given(
    st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, st.floats()), min_size=1, max_size=4),
    st.integers(-2, 258),
)
def test_values_of_any_size_give_the_same_frames_or_the_same_blame(
    values: list[tuple[int, int, int, float]], seq: int
) -> None:
    message = wire.message("NAMED_VALUE_FLOAT")
    command = wire.message("DISTANCE_SENSOR")
    rows = [(t, 20, low, high, 0, 3, 1, 9, f, f, (f,), 0) for t, low, high, f in values]
    columns: list[Any] = [np.array(part) for part in zip(*rows, strict=True)]
    sysids = range(1, len(rows) + 1)
    single = outcome(
        lambda: [command.pack(seq, s, 1, *r) for s, r in zip(sysids, rows, strict=True)]
    )
    at_once = outcome(lambda: Batch(command, sysids, 1).pack(seq, *columns))
    assert isinstance(at_once, str) == isinstance(single, str)
    assert isinstance(at_once, str) or at_once == single
    floats = [row[3] for row in values]
    names = np.full(len(floats), b"speed")
    assert outcome(lambda: Batch(message, sysids, 1).pack(0, 5, names, floats)) == outcome(
        lambda: [message.pack(0, s, 1, 5, "speed", f) for s, f in zip(sysids, floats, strict=True)]
    )


def test_extensions_may_be_left_out_and_what_was_before_is_forgotten() -> None:
    message = wire.message("DISTANCE_SENSOR")
    fleet, base = Batch(message, [4], 1), (5, 20, 400, 33, 0, 3, 1, 9)
    whole = (*base, 0.5, 0.5, (0.1, 0.2), 80)
    assert fleet.pack(0, *whole) == [message.pack(0, 4, 1, *whole)]
    assert fleet.pack(1, *base) == [message.pack(1, 4, 1, *base)]


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({3: 70_000}, "current_distance"),
        ({3: 1.5}, "current_distance"),
        ({8: 1e39}, "horizontal_fov"),
        ({10: (0.0,) * 5}, "quaternion"),
        ({4: "laser"}, "type"),
    ],
)
def test_a_value_that_does_not_fit_is_named(change: dict[int, Any], field: str) -> None:
    values: list[Any] = [5, 20, 400, 33, 0, 3, 1, 9, 0.5, 0.5, (0.1, 0.2), 80]
    for index, value in change.items():
        values[index] = value
    with pytest.raises(ValueError, match=f"DISTANCE_SENSOR.{field}"):
        Batch(wire.message("DISTANCE_SENSOR"), [1, 2], 1).pack(0, *values)


def test_a_sysid_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match=r"HEARTBEAT\.sysid"):
        Batch(wire.message("HEARTBEAT"), [1, 256], 1)
