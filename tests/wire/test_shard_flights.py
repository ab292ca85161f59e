"""One mission in two shards on two addresses of the loopback range, over real UDP."""

from __future__ import annotations

import json
import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mock_process import PATIENCE_S, Mock
from session import Session

pytestmark = pytest.mark.wire

HOSTS = ("127.0.0.1", "127.0.0.2")
STARTS = {"grid": {"origin_m": [6, 6], "spacing_m": 1.5, "columns": 2}}
SPEED = 2.0


class Shards:
    """Two `mock-vehicle`, each with its half of the vehicles."""

    def __init__(
        self,
        world: Path,
        folder: Path,
        vehicles: int,
        ports: tuple[int, int],
        speeds: tuple[float, float] = (SPEED, SPEED),
    ) -> None:
        self.folder, self.speeds = folder, speeds
        self.addresses = list(zip(HOSTS, ports, strict=True))
        shards = ",".join(f"{host}:{port}" for host, port in self.addresses)
        self._words = (world, "--vehicles", vehicles, "--shards", shards, "--port", 0)
        self.mocks = [self.begin(1), self.begin(2)]
        self.ready: list[dict[str, Any]] = []

    def wait(self) -> Shards:
        """Wait until the vehicles' ports are open."""
        self.ready = [mock.line()["ready"] for mock in self.mocks]
        return self

    def begin(self, shard: int) -> Mock:
        """Start one of them."""
        out = self.folder / f"shard{shard}"
        how = ("--rates", "lean", "--speed", self.speeds[shard - 1], "--json", "--out", out)
        return Mock(*self._words, "--shard", shard, *how)

    def links(self) -> list[object]:
        """Give the options that connect controllers to all vehicles."""
        urls = [f"udpout://{one['host']}:{port}" for one in self.ready for port in one["ports"]]
        return [word for url in urls for word in ("--connect", url)]

    def report(self, shard: int, of: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Read what one says until something is so."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not of(line := self.mocks[shard - 1].line()):
            assert time.monotonic() < deadline_s, line
        return line

    def heard(self, shard: int) -> set[tuple[int, int]]:
        """Give who delivered frames to whom, by the books of one."""
        links = json.loads((self.folder / f"shard{shard}" / "radio.json").read_text())["links"]
        return {(one["from"], one["to"]) for one in links if one["delivered"]}


@pytest.fixture
def shards(
    tmp_path: Path, hall: Callable[..., Path], free_udp_port: int
) -> Iterator[Callable[..., Shards]]:
    """Give a function that starts both for so many vehicles."""
    begun: list[Shards] = []

    def begin(vehicles: int, **how: Any) -> Shards:
        mission = hall(vehicles=vehicles, world={"starts": STARTS})
        ports = (free_udp_port, free_udp_port)
        begun.append(Shards(mission.parent / "world.yaml", tmp_path, vehicles, ports, **how))
        return begun[-1].wait()

    yield begin
    for both in begun:
        for mock in both.mocks:
            mock.end()


def test_two_shards_fly_one_mission_and_hear_each_other(
    shards: Callable[..., Shards], tmp_path: Path, swarm_ctl_run: Callable[..., Session]
) -> None:
    both = shards(4)
    assert [one["host"] for one in both.ready] == list(HOSTS)
    assert [one["sysids"] for one in both.ready] == [[1, 2], [3, 4]]
    options = (*both.links(), "--sysid", 1, "--speed", SPEED)
    flight = swarm_ctl_run(tmp_path / "hall.yaml", *options, command="fly")
    flight.process.wait(timeout=90.0)  # half of the mission's 30 s, unless the machine is busy
    code, _, complaints = flight.end()
    assert (code, complaints) == (0, "")
    summary = json.loads((flight.out / "summary.json").read_text())
    assert {one["sysid"]: one["phase"] for one in summary["per_vehicle"]} == dict.fromkeys(
        (1, 2, 3, 4), "done"
    )
    for mock in both.mocks:
        mock.process.send_signal(signal.SIGTERM)
    ends = [mock.wait() for mock in both.mocks]
    assert [code for code, _, _ in ends] == [0, 0]
    done = [lines[-1]["done"] for _, lines, _ in ends]
    assert [one["border"]["refused"] for one in done] == [{}, {}]
    assert abs(done[0]["time_s"] - done[1]["time_s"]) < 2.0, "they keep pace, and end in turn"
    assert {(3, 1), (2, 1), (4, 2)} <= both.heard(1)
    assert {(1, 3), (4, 3), (2, 4)} <= both.heard(2)
    assert not {(1, 3), (2, 4)} & both.heard(1), "each tells of its own hearers"


def test_what_strangers_send_to_a_border_is_counted_and_changes_nothing(
    shards: Callable[..., Shards],
) -> None:
    both = shards(2)
    both.report(1, lambda line: line["time_s"] > 0.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.3", 0))
        for data in (b"", b"MVS1", b"\xff" * 1400, b"MVS1" + bytes(200)):
            stranger.sendto(data, both.addresses[0])
    line = both.report(1, lambda line: line["border"]["refused"])
    assert line["border"]["refused"] == {"stranger": 4}
    assert line["border"]["missing"] == []


def test_who_is_faster_waits_for_who_is_slower(shards: Callable[..., Shards]) -> None:
    both = shards(2, speeds=(8.0, 1.0))
    slow = both.report(2, lambda line: line["time_s"] > 3.0)
    fast = both.report(1, lambda line: line["time_s"] > 3.0)
    for _ in range(2):
        slow, fast = both.mocks[1].line(), both.mocks[0].line()
    assert abs(fast["time_s"] - slow["time_s"]) < 3.0  # lines are a second apart


def test_a_shard_that_dies_is_survived_and_taken_back(shards: Callable[..., Shards]) -> None:
    both = shards(2)
    both.report(1, lambda line: line["time_s"] > 1.0)
    both.mocks[1].process.kill()
    both.mocks[1].end()
    lost = both.report(1, lambda line: line["border"]["missing"])
    assert lost["border"]["missing"] == ["shard 2 at {}:{}".format(*both.addresses[1])]
    both.mocks[1] = both.begin(2)
    both.mocks[1].line()
    back = both.report(2, lambda line: line["time_s"] > 0.0)
    assert back["time_s"] > lost["time_s"], "it goes on at the others' time"
    flying = both.report(1, lambda line: not line["border"]["missing"])
    assert flying["time_s"] > lost["time_s"]


def test_a_shard_alone_waits_and_says_for_whom(
    hall: Callable[..., Path], free_udp_port: int
) -> None:
    world = hall(vehicles=2).parent / "world.yaml"
    shards = f"127.0.0.1:{free_udp_port},127.0.0.2:{free_udp_port}"
    mock = Mock(world, "--vehicles", 2, "--shards", shards, "--shard", 1, "--port", 0, "--json")
    assert mock.line()["ready"]["sysids"] == [1]
    assert mock.line()["time_s"] == 0.0
    mock.process.send_signal(signal.SIGINT)
    code, _, complaints = mock.wait()
    assert code == 0
    assert f"waiting for shard 2 at 127.0.0.2:{free_udp_port}" in complaints


def test_a_shard_of_another_mission_is_not_listened_to(
    hall: Callable[..., Path], free_udp_port: int
) -> None:
    world = hall(vehicles=2).parent / "world.yaml"
    shards = f"127.0.0.1:{free_udp_port},127.0.0.2:{free_udp_port}"
    options = (world, "--vehicles", 2, "--shards", shards, "--port", 0, "--json", "--shard")
    one, other = Mock(*options, 1, "--seed", 1), Mock(*options, 2, "--seed", 2)
    try:
        one.line()
        while not (line := one.line())["border"]["refused"]:
            assert line["time_s"] == 0.0
        assert set(line["border"]["refused"]) == {"other mission"}
        (missing,) = line["border"]["missing"]
        assert missing.endswith("which has another world, seed, --vehicles or --shards")
    finally:
        one.end()
        other.end()
