"""A broker inside this process, for those who have none: amqtt on the loopback (extra `broker`)."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import re
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

from swarm_ctl.bus.mqtt import PORTS, Broker, in_words
from swarm_ctl.errors import SwarmError

HOST = "127.0.0.1"
STOP_S = 10.0
_URL = re.compile(r"embedded(?::([0-9]{1,9}))?")
_ANYBODY = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
for _name in ("amqtt", "transitions"):
    logging.getLogger(_name).setLevel(logging.CRITICAL)  # each client that leaves is a line

Stop = tuple[asyncio.AbstractEventLoop, asyncio.Event]
"""Where the broker runs, and what ends it."""


def embedded_port(url: str) -> int | None:
    """Read `embedded[:PORT]`; None for every other address, SwarmError for no port."""
    if not (found := _URL.fullmatch(url)):
        return None
    port = int(found[1] or PORTS["mqtt"])
    if not 0 < port < 1 << 16:
        raise SwarmError(f"--mqtt {url}: expected a port from 1 to 65535")
    return port


@contextlib.contextmanager
def embedded_broker(port: int) -> Iterator[Broker]:
    """Serve MQTT 3.1.1 to this machine alone until the block ends; everybody on it may enter.

    It has a thread of its own, so that no tick waits for a subscriber, and forgets all at the end.
    SwarmError when it cannot be had.
    """
    amqtt, ready = _amqtt(), Future[Stop]()
    listener = {"type": "tcp", "bind": f"{HOST}:{port}"}
    settings = {"listeners": {"default": listener}, "plugins": _ANYBODY}

    def serve() -> None:
        asyncio.run(_serve(lambda: amqtt(settings), ready))

    thread = threading.Thread(target=serve, name="embedded broker", daemon=True)
    thread.start()
    try:
        loop, stop = ready.result()
    except Exception as error:  # noqa: BLE001 - whatever amqtt makes of it
        cause = error.__cause__ or error
        is_taken = isinstance(cause, OSError) and cause.errno == errno.EADDRINUSE
        reason = "it is in use" if is_taken else in_words(cause)
        sentence = f"--mqtt embedded: port {port} cannot be had: {reason}"
        raise SwarmError(f"{sentence}; name another one, as embedded:18830") from None
    try:
        yield Broker(HOST, port)
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(STOP_S)


class _Subscriptions(dict[str, Any]):
    """Those that were there when somebody began to go through them."""

    def __iter__(self) -> Iterator[str]:
        return iter([*super().keys()])

    def items(self) -> Any:
        return [*super().items()]


def _amqtt() -> Callable[[Any], Any]:
    """Give the broker of amqtt 0.12, mended.

    It goes through its subscriptions while others change them, which ends connections, and gives
    whoever connects what it has kept for all subscribers there are.
    """
    try:
        from amqtt.broker import Broker as Amqtt  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        reason = f"needs {error.name}, which is missing: pip install 'swarm-ctl[broker]'"
        raise SwarmError(f"--mqtt embedded: {reason}") from None

    class Mended(Amqtt):
        def __init__(self, settings: Any) -> None:
            super().__init__(settings)
            self._subscriptions = _Subscriptions()

        async def _publish_retained_messages_for_subscription(
            self, subscription: tuple[str, int], session: Any
        ) -> None:
            subscribers = self._subscriptions.get(subscription[0], ())
            if any(one is session for one, _ in subscribers):
                await super()._publish_retained_messages_for_subscription(subscription, session)

    return Mended


async def _serve(make: Callable[[], Any], ready: Future[Stop]) -> None:
    stop = asyncio.Event()
    try:
        broker = make()
        await broker.start()
    except Exception as error:  # noqa: BLE001 - told where it is waited for
        ready.set_exception(error)
        return
    ready.set_result((asyncio.get_running_loop(), stop))
    await stop.wait()
    with contextlib.suppress(Exception):  # it is at its end in any case
        await broker.shutdown()
