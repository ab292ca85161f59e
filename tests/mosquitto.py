"""A real MQTT broker of a test's own, on the loopback."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

PROGRAM = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin")
PASSWORDS = shutil.which("mosquitto_passwd")
PATIENCE_S = 30.0


class Mosquitto:
    """The broker's process, which a test may kill, freeze and start again on the same port."""

    def __init__(self, folder: Path, *lines: str) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port: int = probe.getsockname()[1]
        self.lines = lines or ("allow_anonymous true",)
        self._settings = folder / "mosquitto.conf"
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        assert PROGRAM is not None
        # It may not read a test's folder as the user of its own to whom it changes from root.
        head = (f"listener {self.port} 127.0.0.1", "user root", "log_dest none")
        self._settings.write_text("\n".join((*head, *self.lines, "")))
        self._process = subprocess.Popen(
            [PROGRAM, "-c", str(self._settings)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            assert self._process.poll() is None, "mosquitto has ended"
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                return
            assert time.monotonic() < deadline_s, "mosquitto does not listen"
            time.sleep(0.01)  # noqa: TID251 - another process is waited for

    def freeze(self) -> None:
        """Let it be there and say nothing."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait(PATIENCE_S)


def with_password(folder: Path, user: str, password: str, *others: str) -> tuple[str, ...]:
    """Give the settings of a broker that only this user may enter, and others with a password."""
    assert PASSWORDS is not None
    file = folder / "passwords"
    file.touch()
    for name in (user, *others):
        add = [PASSWORDS, "-b", str(file), name, password]
        subprocess.run(add, check=True, capture_output=True)
    return ("allow_anonymous false", f"password_file {file}")
