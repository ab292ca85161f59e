"""The pytest plugin: a vehicle or a swarm for a test, as its marker says.

pytest loads this module at every start, so it imports nothing heavy before a fixture is used.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mock_vehicle.testing import RealSwarm, RealVehicle, VirtualSwarm, VirtualVehicle

MARKER = "mock_vehicle"
SWARM = 2
"""Vehicles of a swarm that does not say how many."""


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line(
        "markers",
        f"{MARKER}(autopilot='px4', vehicles=1, world=None, time='real', ...): "
        "which vehicles the fixtures mock_vehicle and mock_swarm fly.",
    )


@pytest.fixture
def free_udp_port() -> int:
    """Give a UDP port of the loopback interface that nobody listens on."""
    from mock_vehicle.ports import free_udp_port as find  # noqa: PLC0415

    return find()


@pytest.fixture
def mock_vehicle(request: pytest.FixtureRequest) -> Iterator[RealVehicle | VirtualVehicle]:
    """Fly one mock vehicle while the test runs."""
    for swarm in _launch(request, "mock_vehicle"):
        yield swarm[swarm.sysids[0]]


@pytest.fixture
def mock_swarm(request: pytest.FixtureRequest) -> Iterator[RealSwarm | VirtualSwarm]:
    """Fly mock vehicles together while the test runs."""
    yield from _launch(request, "mock_swarm")


def _launch(request: pytest.FixtureRequest, fixture: str) -> Iterator[RealSwarm | VirtualSwarm]:
    from mock_vehicle.errors import MockVehicleError  # noqa: PLC0415
    from mock_vehicle.testing import Plan, launch  # noqa: PLC0415

    with contextlib.ExitStack() as running:
        try:
            plan = Plan.of(_arguments(request, fixture))
            swarm = running.enter_context(launch(plan))
        except (MockVehicleError, ValueError) as error:
            raise pytest.fail.Exception(f"{fixture}: {error}", pytrace=False) from None
        yield swarm


def _arguments(request: pytest.FixtureRequest, fixture: str) -> dict[str, Any]:
    """Collect what the markers say, the nearest last, and then the fixture's own parameter."""
    arguments: dict[str, Any] = {"vehicles": 1 if fixture == MARKER else SWARM}
    for marker in reversed(list(request.node.iter_markers(MARKER))):
        if marker.args:
            raise ValueError(f"the marker takes arguments by name, not {marker.args[0]!r}")
        arguments |= marker.kwargs
    parameter = getattr(request, "param", {})
    arguments |= {"autopilot": parameter} if isinstance(parameter, str) else parameter
    if fixture == MARKER and arguments["vehicles"] != 1:
        raise ValueError("flies one vehicle; the fixture mock_swarm flies several")
    if arguments.get("world") is not None:
        arguments["world"] = request.path.parent / arguments["world"]
    return arguments
