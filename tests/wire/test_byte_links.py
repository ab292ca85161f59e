"""TCP and serial links: made again when they break, and never in the event loop's way."""

from __future__ import annotations

import asyncio
import os
import pty
import socket
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from swarm_ctl.errors import SwarmError
from swarm_ctl.link import Link, open_link
from swarm_ctl.link.base import STREAM
from swarm_ctl.link.stream import AGAIN_S

pytestmark = pytest.mark.wire

PATIENCE_S = 30.0


class Ears:
    """What a link's owner hears."""

    def __init__(self, link: Link) -> None:
        self.heard = b""
        link.watch(self.hear)

    def hear(self, data: bytes, source: tuple[str, int]) -> None:
        assert source == STREAM
        self.heard += data


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not is_so():  # noqa: ASYNC110 - a socket tells nobody when it is done
            await asyncio.sleep(0.01)


def listener(port: int = 0) -> socket.socket:
    opened = socket.create_server(("127.0.0.1", port))
    opened.setblocking(False)
    return opened


async def accepted(server: socket.socket) -> socket.socket:
    async with asyncio.timeout(PATIENCE_S):
        return (await asyncio.get_running_loop().sock_accept(server))[0]


# -- TCP -----------------------------------------------------------------------------------------


async def test_a_tcp_peer_that_goes_and_comes_back_is_spoken_to_again() -> None:
    with closing(listener()) as server, closing(tcp(server)) as link:
        ears = Ears(link)
        with closing(await accepted(server)) as first:
            await until(lambda: link.send(b"heartbeat"))
            assert await received(first) == b"heartbeat"
            first.send(b"telemetry")
            await until(lambda: ears.heard == b"telemetry")
        await until(lambda: not link.send(b"to nobody"))
        with closing(await accepted(server)) as second:
            await until(lambda: link.send(b"again"))
            assert await received(second) == b"again"
            second.send(b", more")
            await until(lambda: ears.heard == b"telemetry, more")


async def test_a_tcp_peer_that_is_not_there_yet_is_tried_once_a_second() -> None:
    with closing(listener()) as server:
        port = server.getsockname()[1]
    with closing(open_link(f"tcpout://127.0.0.1:{port}")) as link:
        assert not link.send(b"nobody is there")
        Ears(link)
        await asyncio.sleep(0.2)
        assert not link.send(b"and nobody now")
        with closing(listener(port)) as server:
            began_s = time.monotonic()
            with closing(await accepted(server)):
                assert time.monotonic() - began_s < 3.0 * AGAIN_S


async def test_who_hangs_up_at_once_is_not_called_more_than_once_a_second() -> None:
    calls = 0
    with closing(listener()) as server, closing(tcp(server)) as link:
        Ears(link)
        began_s = time.monotonic()
        while time.monotonic() - began_s < 2.5 * AGAIN_S:
            (await accepted(server)).close()
            calls += 1
        assert 2 <= calls <= 4


async def test_a_full_tcp_connection_loses_datagrams_and_tears_none() -> None:
    datagram = bytes(range(256)) * 8
    with closing(listener()) as server, closing(tcp(server)) as link:
        Ears(link)
        with closing(await accepted(server)) as slow:
            await until(lambda: link.send(datagram))
            sent = 1
            while link.send(datagram):
                sent += 1
            got = await received(slow)
            await until(lambda: link.send(b"end"))
            while not got.endswith(b"end"):
                got += await received(slow)
            whole, rest = divmod(len(got) - 3, len(datagram))
            assert (rest, whole) in {(0, sent), (0, sent + 1)}
            assert got == datagram * whole + b"end"


def tcp(server: socket.socket) -> Link:
    return open_link(f"tcpout://127.0.0.1:{server.getsockname()[1]}")


async def received(connection: socket.socket) -> bytes:
    connection.setblocking(False)
    async with asyncio.timeout(PATIENCE_S):
        return await asyncio.get_running_loop().sock_recv(connection, 1 << 20)


# -- serial --------------------------------------------------------------------------------------


class Usb:
    """A serial port that can be plugged in and out: one end of a pty, under a fixed name."""

    def __init__(self, name: Path) -> None:
        self.name = name
        self.master = -1

    def plug_in(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(self.master)
        os.set_blocking(self.master, False)
        self.name.symlink_to(os.ttyname(slave))
        os.close(slave)

    def pull_out(self) -> None:
        self.name.unlink()
        os.close(self.master)
        self.master = -1

    def read(self) -> bytes:
        try:
            return os.read(self.master, 1 << 16)
        except OSError:  # nothing there, or nobody at the other end
            return b""


@pytest.fixture
def usb(tmp_path: Path) -> Iterator[Usb]:
    port = Usb(tmp_path / "ttyACM0")
    port.plug_in()
    yield port
    if port.master >= 0:
        port.pull_out()


async def test_a_serial_port_speaks_at_its_baud_rate_and_byte_for_byte(usb: Usb) -> None:
    every_byte = bytes(range(256))
    with closing(open_link(f"serial://{usb.name}:921600")) as link:
        ears = Ears(link)
        assert termios.tcgetattr(usb.master)[4] == termios.B921600
        assert link.send(every_byte)
        await until(lambda: usb.read() == every_byte)
        os.write(usb.master, every_byte)
        await until(lambda: ears.heard == every_byte)


async def test_a_serial_port_that_was_pulled_out_is_opened_again_when_it_is_back(usb: Usb) -> None:
    with closing(open_link(f"serial://{usb.name}")) as link:
        ears = Ears(link)
        os.write(usb.master, b"before")
        await until(lambda: ears.heard == b"before")
        usb.pull_out()
        await until(lambda: not link.send(b"to nobody"))
        await asyncio.sleep(0.1)
        usb.plug_in()
        await until(lambda: link.send(b"hello again"))
        await until(lambda: usb.read() == b"hello again")
        os.write(usb.master, b", after")
        await until(lambda: ears.heard == b"before, after")


def test_a_port_that_another_program_uses_is_one_sentence(usb: Usb) -> None:
    url = f"serial://{usb.name}:57600"
    with (
        closing(open_link(url)),
        pytest.raises(SwarmError, match=f"{url}: .*; another program uses it$"),
    ):
        open_link(url)


@pytest.mark.parametrize(
    ("device", "sentence"),
    [("/dev/no-such-port", "No such file or directory"), ("/dev/null", "this is no serial port")],
)
def test_a_port_that_cannot_be_opened_is_one_sentence(device: str, sentence: str) -> None:
    with pytest.raises(SwarmError, match=f"serial://{device}: {sentence}"):
        open_link(f"serial://{device}")


def test_a_missing_pyserial_is_one_sentence(usb: Usb, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(SwarmError, match=r"needs pyserial, .*pip install 'swarm-ctl\[serial\]'"):
        open_link(f"serial://{usb.name}")
