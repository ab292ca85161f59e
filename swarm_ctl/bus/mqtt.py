"""An MQTT broker that may be absent, die, come back or be slow: nothing that flies waits for it."""

from __future__ import annotations

import asyncio
import logging
import secrets
import ssl
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self
from urllib.parse import unquote, urlsplit

import aiomqtt
from paho.mqtt.client import Client

from swarm_ctl.errors import SwarmError

LOG = logging.getLogger(__name__)
_CLIENT_LOG = logging.getLogger(f"{__name__}.client")
_CLIENT_LOG.setLevel(logging.CRITICAL)  # it tells in many lines what we tell in one

PASSWORD_VARIABLE = "SWARM_MQTT_PASSWORD"  # noqa: S105 - the variable's name
"""Environment variable with the password, which a command line shows to everybody."""
PORTS = {"mqtt": 1883, "mqtts": 8883}
KEEPALIVE_S = 10
"""A broker that is silent for one and a half times as long is gone."""
TIMEOUT_S = 5.0
"""Longest wait for one answer of the broker."""
RETRY_S, LONGEST_RETRY_S = 1.0, 30.0
"""Waits between two attempts to connect: the first, and the longest after doubling."""

Session = Callable[[aiomqtt.Client], Awaitable[None]]


class _Client(aiomqtt.Client):
    """Ends in silence when its connection breaks, and leaves the sockets of others alone."""

    def _on_socket_register_write(self, client: Client, _userdata: Any, sock: Any) -> None:
        """Wait until there is room to write; not on a socket that is closed by then.

        Its number may be somebody else's: aiomqtt 2.5 takes it before that is known.
        """

        def wait() -> None:
            if sock.fileno() >= 0:
                self._loop.add_writer(sock.fileno(), write)

        def write() -> None:
            try:
                client.loop_write()
            except Exception as error:  # noqa: BLE001 - whatever it is, the connection broke
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        self._loop.call_soon_threadsafe(wait)

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            await super().__aexit__(kind, error, trace)
        finally:
            if self._disconnected.done():
                self._disconnected.exception()  # else asyncio complains that nobody did


@dataclass(frozen=True, slots=True)
class Broker:
    """Where a broker is and how it is entered; in words, without the password."""

    host: str
    port: int
    tls: ssl.SSLContext | None = None
    user: str | None = None
    password: str | None = field(default=None, repr=False)

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.tls else 'mqtt'}://{host}:{self.port}"

    @classmethod
    def parse(cls, url: str, environment: Mapping[str, str], option: str = "--mqtt") -> Self:
        """Read `mqtt[s]://[user[:password]@]host[:port]`; SwarmError says what is expected."""
        try:
            parts = urlsplit(url)
            port = parts.port or PORTS[parts.scheme]
            host = parts.hostname or ""
            host.encode("idna")
        except (ValueError, KeyError):
            host = ""
        if not host or parts.path not in {"", "/"} or parts.query or parts.fragment:
            words = "expected mqtt://[USER@]HOST[:PORT], or mqtts:// for TLS"
            raise SwarmError(f"{option}: {words}{', or embedded[:PORT]' * (option == '--mqtt')}")
        password = environment.get(PASSWORD_VARIABLE, parts.password and unquote(parts.password))
        user = parts.username and unquote(parts.username)
        tls = ssl.create_default_context() if parts.scheme == "mqtts" else None
        return cls(host, port, tls, user or None, password or None)

    def client(self, name: str = "", will: aiomqtt.Will | None = None) -> aiomqtt.Client:
        """Prepare a client with a session of its own, of which nothing is left when it ends.

        A connection of the same `name` is ended by this one; the broker tells its last `will`
        when it breaks.
        """
        return _Client(
            self.host,
            self.port,
            username=self.user,
            password=self.password,
            protocol=aiomqtt.ProtocolVersion.V311,
            identifier=name or f"swarm-ctl-{secrets.token_hex(6)}",
            will=will,
            clean_session=True,
            keepalive=KEEPALIVE_S,
            timeout=TIMEOUT_S,
            tls_context=self.tls,
            logger=_CLIENT_LOG,
        )


async def may_hear(
    client: aiomqtt.Client, topics: Sequence[str], qos: int, what: str = "the orders"
) -> None:
    """Subscribe; MqttError when the broker does not let us."""
    granted = await client.subscribe([(topic, qos) for topic in topics])
    if any(getattr(code, "is_failure", False) for code in granted):
        raise aiomqtt.MqttError(f"it does not let us hear {what}")


async def stay_connected(
    broker: Broker,
    session: Session,
    *,
    without: str = "it",
    longest_retry_s: float = LONGEST_RETRY_S,
    is_quiet: bool = False,
) -> None:
    """Run a session, and another one whenever it has ended, until cancelled; never raises.

    Each loss of the broker is one warning, what we fly on `without`, and so is its return; a
    session that `is_quiet` leaves them to another one with the same broker.
    """
    level = logging.DEBUG if is_quiet else logging.WARNING
    loop, wait_s, is_told = asyncio.get_running_loop(), RETRY_S, False
    while True:
        began_s = loop.time()
        try:
            async with broker.client() as client:
                if is_told:
                    LOG.log(level, "%s: connected again", broker)
                is_told = False
                await session(client)
        except Exception as error:  # noqa: BLE001 - whatever it is, the vehicles fly on
            _end_if_cancelled()
            if not is_told:
                LOG.log(level, "%s: %s; flying on without %s", broker, in_words(error), without)
            is_told = True
        if loop.time() - began_s > longest_retry_s:
            wait_s = RETRY_S
        await asyncio.sleep(wait_s)
        wait_s = min(2.0 * wait_s, longest_retry_s)


def in_words(error: BaseException) -> str:
    """Give the reason for the end of a session in one line."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return " ".join(str(error).split()) or type(error).__name__


def _end_if_cancelled() -> None:
    """Go on being cancelled: an error while a client was closed has taken that error's place."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
