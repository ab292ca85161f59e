"""Charts whose lines stretch with the page while their words keep their size."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.record.report.markup import Markup, tag

MOST_POINTS = 400
"""Of a line: more than a page can show."""


@dataclass
class Plot:
    """A chart of lines over time; x and y begin at 0."""

    x_max: float
    y_max: float
    y_label: str
    x_label: str = "mission time, s"
    lines: list[Markup] = field(default_factory=list)
    marks: list[Markup] = field(default_factory=list)
    keys: list[Markup] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Leave some room in a chart of nothing."""
        self.x_max, self.y_max = max(self.x_max, 1.0), max(self.y_max, 1e-9)

    def line(
        self,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        cls: str,
        *,
        key: str = "",
        title: str = "",
        is_filled: bool = False,
        colour: str = "",
    ) -> None:
        """Draw a line; with a key it is named beneath the chart."""
        known = np.flatnonzero(np.isfinite(y))
        if not len(known):
            return
        step = math.ceil(len(known) / MOST_POINTS)
        chosen = np.unique(np.append(known[::step], known[-1]))
        px, py = 1000.0 * x[chosen] / self.x_max, 1000.0 - 1000.0 * y[chosen] / self.y_max
        points = " ".join(f"{a:.0f},{b:.0f}" for a, b in zip(px, py, strict=True))
        if is_filled:
            area = f"M{px[0]:.0f},1000L{points}L{px[-1]:.0f},1000Z"
            self.lines.append(tag("path", d=area, cls=f"{cls} area"))
        hint = [tag("title", title)] if title else []
        style = f"stroke:{colour}" if colour else None
        self.lines.append(tag("path", *hint, d=f"M{points}", cls=cls, style=style))
        if key:
            self.keys.append(tag("span", tag("i", cls=cls, style=style), key))

    def mark(self, x: float, y: float, words: str, cls: str, sign: str = "★") -> None:
        """Put a sign at a place, with words for who points at it."""
        where = f"left:{100.0 * x / self.x_max:.2f}%;bottom:{100.0 * y / self.y_max:.2f}%"
        self.marks.append(tag("b", sign, cls=f"mark {cls}", style=where, title=words))

    def key(self, words: str, cls: str, sign: str = "★") -> None:
        """Say what a sign means."""
        self.keys.append(tag("span", tag("b", sign, cls=f"mark {cls}"), words))

    def html(self) -> Markup:
        """Write the chart."""
        ys, xs = ticks(self.y_max, 5), ticks(self.x_max, 6)
        grid = [_grid_line(1000.0 - 1000.0 * y / self.y_max) for y in ys]
        svg = tag(
            "svg",
            *grid,
            *self.lines,
            viewBox="0 0 1000 1000",
            preserveAspectRatio="none",
        )
        left = [
            tag("span", f"{y:g}", cls="y", style=f"bottom:{100.0 * y / self.y_max:.2f}%")
            for y in ys
        ]
        return tag(
            "div",
            tag("div", self.y_label, cls="ylabel"),
            tag("div", svg, *left, *self.marks, cls="plot"),
            x_axis(xs, self.x_max),
            tag("div", self.x_label, cls="xlabel"),
            tag("div", *self.keys, cls="keys"),
            cls="chart",
        )


def ticks(most: float, count: int) -> list[float]:
    """Give round numbers from 0 to `most`, about `count` of them."""
    rough = max(most, 1e-9) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough * 0.999)
    return [round(index * step, 9) for index in range(math.floor(most / step + 1e-9) + 1)]


def x_axis(values: Iterable[float], most: float) -> Markup:
    """Write the numbers beneath a chart."""
    return tag(
        "div",
        *(tag("span", f"{x:g}", style=f"left:{100.0 * x / most:.2f}%") for x in values),
        cls="xaxis",
    )


def _grid_line(y: float) -> Markup:
    return tag("line", x1=0, x2=1000, y1=f"{y:.0f}", y2=f"{y:.0f}", cls="grid")
