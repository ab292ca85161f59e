"""Files that are only ever added to, and that end a flight's record rather than the flight."""

from __future__ import annotations

import os
from pathlib import Path


class AppendFile:
    """Hands whole records to the kernel: a kill loses no more than what was not flushed.

    A file that cannot be written to any more, as on a full disk, ends for good and keeps why.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fault = ""
        """Why nothing is written any more, in words."""
        self.is_closed = False
        self.fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        self._waiting = bytearray()
        self._is_synced = True

    def write(self, record: bytes, *, flush: bool = True) -> None:
        """Add a record, now or with the next one that is flushed; never raises."""
        if self.fault or self.is_closed:
            return
        self._waiting += record
        if flush:
            self.flush()

    def flush(self) -> None:
        """Hand over what waits; never raises."""
        data, self._waiting = bytes(self._waiting), bytearray()
        try:
            while data and not self.fault:
                data = data[os.write(self.fd, data) :]
                self._is_synced = False
        except OSError as error:
            self.fault = error.strerror or str(error)

    def sync(self) -> None:
        """Wait until the disk has it, in another thread if wanted; OSError if it never will."""
        if self.fault:
            raise OSError(None, self.fault, str(self.path))
        if not self._is_synced:
            self._is_synced = True
            os.fsync(self.fd)

    def close(self) -> None:
        """Hand over what waits and close the file; more than once does no harm."""
        if not self.is_closed:
            self.flush()
            self.is_closed = True
            os.close(self.fd)
