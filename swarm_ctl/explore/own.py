"""Planners that are not ours: a mission names one as `module:Class`."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from collections.abc import Callable
from typing import Any

OWN = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
"""How a planner of one's own is named."""


def find_planner(kind: str) -> Callable[..., Any]:
    """Import `module:Class`, if need be from the working directory; ValueError says what is wrong.

    The class is built and asked as `explore.planner.Planner`, whose docstrings say what comes in
    and goes out, with one seed for each vehicle that it plans for: one in flight, many in
    experiments.
    """
    module, _, name = kind.partition(":")
    if "" not in sys.path:
        sys.path.append("")  # where a script would find it, but a command would not
    try:
        found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except AttributeError:
        raise ValueError(f"there is no {name} in {module}") from None
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(
            f"cannot import {module} here or from what is installed: {reason}"
        ) from error
    if not callable(getattr(found, "step", None)):
        raise ValueError(f"{name} in {module} should be a class with a method step")  # noqa: TRY004 - of a file
    try:
        inspect.signature(found).bind(None, speed_m_s=1.0, climb_m_s=1.0, seeds=[0])
    except TypeError as error:
        wanted = f"{name}(params, *, speed_m_s, climb_m_s, seeds)"
        raise ValueError(f"{module} should have {wanted}: {error}") from None
    return found
