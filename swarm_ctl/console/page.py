"""The page in the browser: sends frames as fast as they are drawn, and takes what is clicked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from nicegui import events, ui

from swarm_ctl.console.picture import Cursor, Frame, Picture

WEB = Path(__file__).with_name("web")


class Source(Protocol):
    """What one browser looks at: a mission as it is flown, or as it was."""

    period_s: float
    """Between two frames."""

    def picture(self) -> Picture:
        """Give what is to be seen now."""

    def state(self) -> dict[str, Any]:
        """Give what the page has to say beside it: whether it plays, what is wrong."""

    def handlers(self) -> dict[str, Callable[[Any], None]]:
        """Give what is to be done with what an operator clicks: by the event's name."""


class Board(ui.element, component="web/board.js", esm={"swarm-console": "web"}):
    """The whole page as one element, to which one message a frame is sent."""

    def __init__(self, source: Source) -> None:
        super().__init__()
        self._source = source
        self._cursor = Cursor()
        self._is_waiting = False
        self.on("ready", self._begin)
        self.on("drawn", self._take_note)
        for name, handle in source.handlers().items():
            self.on(name, _hand_over(handle))

    def _begin(self) -> None:
        """Send the first frame: the page has just been opened, or opened again."""
        self._cursor, self._is_waiting = Cursor(), True

    def _take_note(self) -> None:
        self._is_waiting = True

    def tick(self) -> None:
        """Send a frame if the last one was drawn: a slow browser gets fewer, and no queue."""
        if self._is_waiting:
            self._is_waiting = False
            self.show({**self._source.picture().frame(self._cursor), **self._source.state()})

    def show(self, frame: Frame) -> None:
        """Send a frame."""
        self.run_method("show", frame)


def build(source: Source) -> None:
    """Build the page for one browser; what it looks at is its own."""
    ui.add_css(WEB / "board.css")
    board = Board(source)
    ui.timer(source.period_s, board.tick)


def _hand_over(handle: Callable[[Any], None]) -> Callable[[events.GenericEventArguments], None]:
    def take(event: events.GenericEventArguments) -> None:
        handle(event.args)

    return take
