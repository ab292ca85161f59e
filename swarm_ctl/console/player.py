"""What plays a replay: time goes on, jumps, goes faster."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from swarm_ctl.console.picture import Picture
from swarm_ctl.console.replay import Replay

FASTEST = 100.0


class Player:
    """One browser's replay; it stands at its beginning until somebody plays it."""

    period_s = 0.1
    """Between two frames."""

    def __init__(self, replay: Replay, clock: Callable[[], float]) -> None:
        """Play by a clock in seconds."""
        self._replay = replay
        self._clock = clock
        self._picture = replay.at(0.0)
        self._playing = False
        self._speed = 1.0
        self._played_s = clock()

    def picture(self) -> Picture:
        """Give how things were at the time where the replay is now."""
        now = self._clock()
        if self._playing:
            time_s = self._picture.time_s + self._speed * (now - self._played_s)
            self._replay.advance(self._picture, min(time_s, self._replay.duration_s))
            self._playing = time_s < self._replay.duration_s
        self._played_s = now
        return self._picture

    def state(self) -> dict[str, Any]:
        """Tell whether it plays."""
        return {"playing": self._playing}

    def handlers(self) -> dict[str, Callable[[Any], None]]:
        """Play and pause, seek, change the speed."""
        return {"play": self.play, "seek": self.seek, "speed": self.set_speed}

    def play(self, wanted: object) -> None:
        """Play or pause; at the end, begin again."""
        self.picture()
        self._playing = wanted is True
        if self._playing and self._picture.time_s >= self._replay.duration_s:
            self._picture = self._replay.at(0.0)

    def seek(self, time_s: object) -> None:
        """Go to a mission time, as far as there is one."""
        if isinstance(time_s, int | float) and math.isfinite(time_s):
            self.picture()
            self._picture = self._replay.at(min(max(time_s, 0.0), self._replay.duration_s))

    def set_speed(self, speed: object) -> None:
        """Play so many times as fast as it was flown."""
        if isinstance(speed, int | float) and 0.0 < speed <= FASTEST:
            self.picture()
            self._speed = float(speed)
