"""The door of the page: nobody enters without the token that was printed at the start."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

Scope = MutableMapping[str, Any]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

REFUSAL = b"This page is for its operator: open the address that swarm-ctl console printed.\n"
POLICY_VIOLATION = 1008
"""How a websocket is refused (RFC 6455, 7.4.1)."""


class Door:
    """Let requests and sockets with the token pass to an application (ASGI).

    The token comes once in the address and is then a cookie that scripts cannot read. A socket
    has to come from our own page: a browser sends cookies for pages of other ports, too.
    """

    def __init__(self, app: App, token: str, port: int) -> None:
        self.app = app
        self._token = token
        self._cookie = f"swarm_console_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, one socket, or the life of the application."""
        if scope["type"] == "lifespan" or self._may_enter(scope):
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
        elif self._is_token(
            parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        ):
            cookie = f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
            await _answer(send, 303, [(b"location", b"/"), (b"set-cookie", cookie.encode())])
        else:
            await _answer(send, 403, [(b"content-type", b"text/plain")], REFUSAL)

    def _may_enter(self, scope: Scope) -> bool:
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        try:
            cookie = SimpleCookie(headers.get(b"cookie", "")).get(self._cookie)
        except CookieError:
            return False
        if cookie is None or not self._is_token(cookie.value):
            return False
        origin = headers.get(b"origin")
        return origin is None or urlsplit(origin).netloc == headers.get(b"host")

    def _is_token(self, word: str) -> bool:
        return hmac.compare_digest(word.encode(), self._token.encode())


async def _answer(
    send: Send, status: int, headers: list[tuple[bytes, bytes]], body: bytes = b""
) -> None:
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
