"""A signed fleet over real UDP, flown by pymavlink, which signs, too."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.signing import KEY_VARIABLE, key_of, timestamp_of

pytestmark = pytest.mark.wire

WORLD = "{name: yard, size_m: [30, 20], ceiling_m: 5}"
PASSPHRASE = "correct horse battery staple"  # noqa: S105 - of nothing but this test
PATIENCE_S = 30.0
UNSIGNED, REPLAYED = "Unsigned commands refused", "Replayed commands refused"


class Companion:
    """A socket and pymavlink's codec, with or without the key."""

    def __init__(self, port: int, key: bytes | None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(("127.0.0.1", port))
        self.codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        signing = self.codec.signing
        signing.secret_key, signing.sign_outgoing = key, key is not None
        signing.timestamp = timestamp_of(datetime.now(UTC))
        self.heard: list[Any] = []

    def command(self, number: int, *params: float) -> bytes:
        """Send a command, and give the datagram that it was."""
        seven = (*params, *(0.0,) * 7)[:7]
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *seven)
        data = bytes(message.pack(self.codec))
        self.socket.send(data)
        return data

    def expect(self, wanted: Callable[[Any], bool], each: Callable[[], object] = list) -> Any:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for message in self.codec.parse_buffer(self.socket.recv(4096)) or []:
                self.heard.append(message)
                if wanted(message):
                    return message
            each()
        pytest.fail("the message never came")

    def listen(self, heartbeats: int) -> list[Any]:
        """Give what is heard until so many heartbeats have come."""
        self.heard.clear()
        for _ in range(heartbeats):
            self.expect(lambda m: m.get_type() == "HEARTBEAT")
        return self.heard


def texts(messages: list[Any]) -> list[str]:
    return [m.text for m in messages if m.get_type() == "STATUSTEXT"]


def acknowledged(number: int) -> Callable[[Any], bool]:
    return lambda m: m.get_type() == "COMMAND_ACK" and m.command == number


@pytest.fixture
def world(tmp_path: Path) -> Path:
    file = tmp_path / "yard.yaml"
    file.write_text(WORLD)
    return file


@contextmanager
def mock(*arguments: object, **environment: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-m", "mock_vehicle", *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | environment,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def signed(world: Path, kind: str) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """Give the port of a vehicle with the key, and its process."""
    file = world.with_name("key")
    file.write_text(f"{PASSPHRASE}\n")
    options = ("--port", 0, "--json", "--autopilot", kind, "--signing-key", file)
    with mock(world, *options) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["ready"]["ports"][0], process


@contextmanager
def meet(port: int, key: bytes | None = None) -> Iterator[Companion]:
    companion = Companion(port, key)
    try:
        yield companion
    finally:
        companion.socket.close()


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_the_holder_of_the_key_flies_and_a_replayed_command_does_not(
    world: Path, kind: str
) -> None:
    with signed(world, kind) as (port, process), meet(port, key_of(PASSPHRASE)) as pilot:
        pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 0)
        pilot.expect(lambda m: m.get_type() == "HEARTBEAT" and m.system_status == 3)
        if kind == "ardupilot":
            pilot.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
            assert pilot.expect(acknowledged(176)).result == 0
        captured = pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        assert pilot.expect(acknowledged(400)).result == 0
        pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        assert pilot.expect(acknowledged(400)).result == 0
        for _ in range(100):
            pilot.socket.send(captured)
        heard = pilot.listen(3)
        assert texts(heard).count(REPLAYED) == 1
        assert not any(acknowledged(400)(m) for m in heard)
        assert heard[-1].base_mode & 128 == 0
        known = [m for m in heard if not m.get_type().startswith("UNKNOWN")]  # as CURRENT_MODE
        assert all(m.get_signed() for m in known)
        process.communicate()


def test_who_has_no_key_hears_all_and_is_told_once_that_it_is_not_obeyed(world: Path) -> None:
    with signed(world, "px4") as (port, process), meet(port) as stranger:
        for _ in range(200):
            stranger.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        heard = stranger.listen(3)
        assert texts(heard) == [UNSIGNED]
        assert not any(acknowledged(400)(m) for m in heard)
        assert process.stdin is not None
        process.stdin.close()
        assert process.stdout is not None
        done = json.loads(process.stdout.read().splitlines()[-1])["done"]
        assert done["refused"] == 200


def test_the_key_may_stand_in_the_environment(world: Path) -> None:
    options = (world, "--port", 0, "--json", "--duration", 1)
    with mock(*options, **{KEY_VARIABLE: key_of(PASSPHRASE).hex()}) as process:
        assert process.stdout is not None
        port = json.loads(process.stdout.readline())["ready"]["ports"][0]
        with meet(port, key_of(PASSPHRASE)) as pilot:
            pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148)
            assert pilot.expect(acknowledged(512)).result == 0
        process.communicate()


@pytest.mark.parametrize(
    ("content", "complaint"), [("", "a key is one line"), (None, "No such file")]
)
def test_a_bad_key_file_is_one_sentence(world: Path, content: str | None, complaint: str) -> None:
    file = world.with_name("key")
    if content is not None:
        file.write_text(content)
    with mock(world, "--port", 0, "--signing-key", file) as process:
        _, error = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2
    assert error.startswith(f"mock-vehicle: signing key {file}: ")
    assert complaint in error
    assert len(error.splitlines()) == 1
