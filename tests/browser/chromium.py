"""Debian's Chromium without a window, led over its DevTools protocol as a user's hand would."""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit
from urllib.request import urlopen

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PROGRAM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
PATIENCE_S = 60.0
FLAGS = (
    "--headless=new",
    "--no-sandbox",  # tests may run as root
    "--no-first-run",
    "--remote-debugging-port=0",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
)


class Chromium:
    """One page in a browser of a test's own; use it as a context."""

    def __init__(self, folder: Path, *, width: int = 1440, height: int = 900) -> None:
        assert PROGRAM is not None
        size = f"--window-size={width},{height}"
        profile = f"--user-data-dir={folder / 'chromium'}"
        self._process = subprocess.Popen(
            [PROGRAM, *FLAGS, size, profile, "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._port_file = folder / "chromium" / "DevToolsActivePort"
        self._last = 0
        self.said: list[str] = []
        """Errors and warnings of the page's scripts."""
        self.bytes = 0
        """What the page has received over its sockets."""
        self.frames = 0
        """Messages of these that told it to draw."""
        self.hosts: set[str] = set()
        """Of which it has asked for anything."""
        self._open = contextlib.ExitStack()
        self._open.callback(self._end)
        with contextlib.ExitStack() as trouble:  # whatever goes wrong here, no browser stays
            trouble.callback(self._open.close)
            self._begin(width, height)
            trouble.pop_all()

    def _begin(self, width: int, height: int) -> None:
        self._socket = self._open.enter_context(connect(self._page_address(), max_size=None))
        for domain in ("Page", "Runtime", "Network"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip

    def open(self, address: str) -> None:
        """Go to an address; what is on it may still be on its way."""
        self.call("Page.navigate", url=address)

    def run(self, script: str) -> Any:
        """Evaluate an expression in the page and give its value."""
        told = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def until(self, script: str, patience_s: float = PATIENCE_S) -> Any:
        """Wait until an expression is true, and give its value."""
        deadline_s = time.monotonic() + patience_s
        while True:
            with contextlib.suppress(AssertionError):
                if value := self.run(script):
                    return value
            assert time.monotonic() < deadline_s, f"never true: {script}; the page said {self.said}"
            time.sleep(0.1)  # noqa: TID251 - another process is waited for

    def click(self, selector: str) -> None:
        """Press the mouse in the middle of an element, when it is there."""
        box = f"document.querySelector({json.dumps(selector)})"
        self.until(f"!!{box}")
        x, y = self.run(
            f"(() => {{ const r = {box}.getBoundingClientRect();"
            " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def picture(self, file: Path) -> None:
        """Save what is to be seen as a PNG."""
        told = self.call("Page.captureScreenshot", format="png")
        file.write_bytes(base64.b64decode(told["data"]))

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Ask for something of the protocol, and wait for the answer."""
        self._last += 1
        self._socket.send(json.dumps({"id": self._last, "method": method, "params": params}))
        while True:
            told = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if told.get("id") == self._last:
                assert "error" not in told, told["error"]
                return dict(told["result"])
            self._note(told)

    def _note(self, told: dict[str, Any]) -> None:
        params = told.get("params", {})
        match told.get("method"):
            case "Runtime.consoleAPICalled" if params["type"] in {"error", "warning"}:
                self.said.append(" ".join(str(arg.get("value", "")) for arg in params["args"]))
            case "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                self.said.append(details.get("exception", {}).get("description", details["text"]))
            case "Network.requestWillBeSent":
                self.hosts.add(urlsplit(params["request"]["url"]).hostname or "")
            case "Network.webSocketFrameReceived":
                payload = params["response"]["payloadData"]
                self.bytes += len(payload)
                self.frames += '"show"' in payload.replace("\\", "")

    def close(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            self.call("Browser.close")
        self._open.close()

    def _end(self) -> None:
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(10.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _page_address(self) -> str:
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            assert self._process.poll() is None, "chromium has ended"
            with contextlib.suppress(OSError, IndexError, StopIteration, ValueError):
                port = int(self._port_file.read_text().splitlines()[0])
                with urlopen(f"http://127.0.0.1:{port}/json") as answer:
                    pages = json.loads(answer.read())
                return str(next(p for p in pages if p["type"] == "page")["webSocketDebuggerUrl"])
            assert time.monotonic() < deadline_s, "chromium does not answer"
            time.sleep(0.05)  # noqa: TID251 - another process is waited for
