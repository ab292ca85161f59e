"""Files that are only ever added to, and that end a flight's record rather than the flight."""

from __future__ import annotations

import os
from pathlib import Path


class AppendFile:
    """Hands whole records to the kernel: a kill loses nothing of them.

    A file that cannot be written to any more, as on a full disk, ends for good and keeps why.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fault = ""
        """Why nothing is written any more, in words."""
        self.is_closed = False
        self.fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        self._is_synced = True

    def write(self, record: bytes) -> None:
        """Hand over a record; never raises."""
        try:
            while record and not self.fault and not self.is_closed:
                record = record[os.write(self.fd, record) :]
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
        """Close the file; more than once does no harm."""
        if not self.is_closed:
            self.is_closed = True
            os.close(self.fd)
