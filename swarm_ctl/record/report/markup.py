"""HTML and SVG in a few words: what is text is escaped, what is markup stays."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

VOID = frozenset({"img", "input", "meta", "br", "line", "rect", "path", "circle", "polygon"})
"""Elements without content."""


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def tag(name: str, /, *children: str, **attributes: Any) -> Markup:
    """Write an element; `cls` is its class, `data_x` is data-x, None and False leave one out."""
    written = "".join(
        f' {_name(key)}="{escape(str(value))}"' if value is not True else f" {_name(key)}"
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    if not children and name in VOID:
        return Markup(f"<{name}{written}/>")
    return Markup(f"<{name}{written}>{join(*children)}</{name}>")


def join(*children: str) -> Markup:
    """Put pieces one after the other."""
    return Markup(
        "".join(child if isinstance(child, Markup) else escape(child) for child in children)
    )


def table(heads: list[str], rows: list[list[str]], *, cls: str = "") -> Markup:
    """Write a table that scrolls sideways where it is too wide; numbers are set to the right."""
    head = tag("tr", *(tag("th", head, scope="col") for head in heads))
    body = [tag("tr", *(tag("td", cell, cls=_cell(cell)) for cell in row)) for row in rows]
    written = tag("table", tag("thead", head), tag("tbody", *body))
    return tag("div", written, cls=f"wide {cls}".strip())


def picture(rgba: NDArray[np.uint8], words: str, **attributes: Any) -> Markup:
    """Write an image (rows, columns, 4) into the page; its first row is at the top."""
    from PIL import Image  # noqa: PLC0415 - not every command draws

    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgba), "RGBA").quantize(255).save(file, "PNG")
    data = base64.b64encode(file.getvalue()).decode()
    return tag("img", src=f"data:image/png;base64,{data}", alt=words, **attributes)


def hexadecimal(colour: Any) -> str:
    """Write a colour of the pictures as a page does."""
    if isinstance(colour, str):
        return colour
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


def _name(key: str) -> str:
    return "class" if key == "cls" else key.rstrip("_").replace("_", "-")


def _cell(text: str) -> str | None:
    """Set to the right what begins as a number does."""
    plain = text.lstrip("-<")
    return "n" if plain[:1].isdigit() else None
