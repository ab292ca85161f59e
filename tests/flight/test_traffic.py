"""Bytes a second that a vehicle tells its peers, with ten of them in range."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml

from swarm_ctl.agent.budget import LIMIT_BYTES
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.flight import sign_with
from swarm_ctl.link.mesh import _broadcasts
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded
from swarm_ctl.signing import timestamp_of

MISSIONS = Path(__file__).parents[2] / "missions"
VEHICLES = 11
IN_RANGE_S = 15.0
"""All are in the air and near one another."""
UDP_IP_BYTES = 28
MQTT_TCP_IP_BYTES = 40 + 4 + len("swarm/usar_office/11/peers")
APART = {"partitions": [{"from_s": 0.0, "until_s": 30.0, "groups": [[1, 2, 3, 4, 5]]}]}
KEY, BEGAN = b"k" * 32, datetime(2026, 5, 1, tzinfo=UTC)


class Traffic:
    """What leaves each vehicle of an arena for its peers, whatever carries it."""

    def __init__(self, arena: Arena) -> None:
        self.said: list[list[tuple[float, int]]] = [[] for _ in arena.controllers]
        """Time and bytes of frames, of each datagram."""
        deliver = arena.fleet.receive

        def receive(index: int, data: bytes, now: float, link: int = 0) -> None:
            if frames := _broadcasts(data):
                self.said[index].append((now, sum(len(frame.raw) for frame in frames)))
            deliver(index, data, now, link)

        arena.fleet.receive = receive  # type: ignore[method-assign]

    def seconds(self, overhead: int) -> Iterator[int]:
        """Give the bytes of every second that ends with a datagram, with its headers."""
        for said in self.said:
            window: deque[tuple[float, int]] = deque()
            for now, count in said:
                window.append((now, count + overhead))
                while now - window[0][0] >= 1.0 - 1e-6:
                    window.popleft()
                if now > IN_RANGE_S:
                    yield sum(told for _, told in window)


@pytest.fixture
def fly(tmp_path: Path) -> Callable[..., Traffic]:
    """Give a function that flies a mission whose radio carries all over the world."""

    def fly(mission: str, until_s: float, *, is_signed: bool, **radio: Any) -> Traffic:
        loaded = load_mission(MISSIONS / mission, vehicles=VEHICLES)
        world = yaml.safe_load(loaded.simulated.read_text())
        if "map" in world:
            world["map"] = str(loaded.simulated.parent / world["map"])
        world["radio"] = {**world.get("radio", {}), "radius_m": 500.0, **radio}
        file = tmp_path / "wide.yaml"
        file.write_text(yaml.safe_dump(world))
        arena = Arena(loaded.model_copy(update={"world": file}), Unrecorded())
        if is_signed:
            arena.fleet.sign_with(KEY, timestamp_of(BEGAN))
            sign_with(KEY, arena.controllers, BEGAN)
        traffic = Traffic(arena)
        arena.fly(until_s=until_s)
        assert arena.fleet.radio.linked.sum() == VEHICLES * (VEHICLES - 1)
        assert all(len(one.agent.neighbours) == VEHICLES - 1 for one in arena.controllers)
        return traffic

    return fly


@pytest.mark.parametrize(
    ("mission", "is_signed", "radio"),
    [
        ("usar_office.yaml", False, {}),
        ("open_3d.yaml", True, {}),
        ("open_3d.yaml", True, APART),
    ],
    ids=["office", "open, signed", "open, signed, swarm meets again"],
)
def test_a_vehicle_tells_ten_neighbours_less_than_2000_bytes_in_any_second(
    fly: Callable[..., Traffic],
    request: pytest.FixtureRequest,
    mission: str,
    is_signed: bool,
    radio: dict[str, Any],
) -> None:
    traffic = fly(mission, 40.0, is_signed=is_signed, **radio)
    words = []
    for name, overhead in (("frames", 0), ("UDP", UDP_IP_BYTES), ("MQTT", MQTT_TCP_IP_BYTES)):
        seconds = list(traffic.seconds(overhead))
        words.append(f"{name} {sum(seconds) / len(seconds):.0f}, worst {max(seconds)}")
    print(f"{request.node.callspec.id}: {'; '.join(words)} bytes a second")  # noqa: T201
    assert max(traffic.seconds(MQTT_TCP_IP_BYTES)) < LIMIT_BYTES
