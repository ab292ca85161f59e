"""Vehicles in a test's own process, on UDP, and the pytest plugin as its users meet it."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.testing import Plan, RealSwarm, RealVehicle, launch

pytestmark = pytest.mark.wire

PATIENCE_S = 30.0
HEAVY = {
    "numpy",
    "pydantic",
    "pymavlink",
    "yaml",
    "PIL",
    "mock_vehicle.fleet",
    "mock_vehicle.server",
}


class Client:
    """A plain socket that a vehicle calls."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.settimeout(PATIENCE_S)
        self.codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.callers: dict[int, Any] = {}

    def hear(self, kind: str = "HEARTBEAT") -> Any:
        while True:
            data, caller = self.socket.recvfrom(2048)
            for message in self.codec.parse_buffer(data) or []:
                self.callers[message.get_srcSystem()] = caller
                if message.get_type() == kind:
                    return message

    def send(self, message: Any, sysid: int = 1) -> None:
        self.socket.sendto(message.pack(self.codec), self.callers[sysid])

    def setpoint(self) -> None:
        zeros = (0.0,) * 3
        values = (*zeros, 0.0, 0.0, -1.0, *zeros, 0.0, 0.0)
        self.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x5C7, *values))


@pytest.fixture
def clients() -> Iterator[list[Client]]:
    """Whoever stands in the list is hung up on in the end."""
    met: list[Client] = []
    yield met
    for client in met:
        client.socket.close()


def test_the_vehicle_calls_a_client_and_notes_what_it_sends(
    mock_vehicle: RealVehicle, clients: list[Client]
) -> None:
    clients.append(client := Client(mock_vehicle.port))
    heartbeat = client.hear()
    assert (heartbeat.get_srcSystem(), heartbeat.autopilot) == (1, 12)
    assert client.callers[1] == mock_vehicle.address
    assert mock_vehicle.url == f"udpin://127.0.0.1:{mock_vehicle.port}"
    assert mock_vehicle.pymavlink_url == f"udpin:127.0.0.1:{mock_vehicle.port}"
    for _ in range(5):
        client.setpoint()
        client.hear("ATTITUDE")
    mock_vehicle.wait_until(lambda _: len(mock_vehicle.setpoint_times) == 5)
    assert len(mock_vehicle.received("SET_POSITION_TARGET_LOCAL_NED")) == 5
    assert mock_vehicle.setpoint_times == sorted(mock_vehicle.setpoint_times)


def test_a_client_may_call_first(mock_vehicle: RealVehicle, clients: list[Client]) -> None:
    clients.append(client := Client(0))
    client.callers[1] = mock_vehicle.address
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    assert client.hear().get_srcSystem() == 1


def test_px4_calls_a_ground_station_on_a_port_of_its_own(
    mock_vehicle: RealVehicle, clients: list[Client]
) -> None:
    assert mock_vehicle.gcs_port != mock_vehicle.port
    clients.append(ground := Client(mock_vehicle.gcs_port))
    assert ground.hear().get_srcSystem() == 1


@pytest.mark.mock_vehicle(vehicles=3, autopilot="ardupilot", one_port=True, sysid=5)
def test_a_swarm_calls_one_port(mock_swarm: RealSwarm, clients: list[Client]) -> None:
    (port,) = {vehicle.port for vehicle in mock_swarm}
    clients.append(client := Client(port))
    while set(client.callers) != {5, 6, 7}:
        client.hear()
    assert sorted(client.callers.values()) == sorted(vehicle.address for vehicle in mock_swarm)
    assert len(mock_swarm.wait_until(lambda truths: all(t.time_s > 0.1 for t in truths))) == 3


def test_each_of_a_swarm_calls_its_own_port(mock_swarm: RealSwarm) -> None:
    ports = {port for vehicle in mock_swarm for port in (vehicle.port, vehicle.gcs_port)}
    assert len(ports) == 2 * len(mock_swarm) == 4


@pytest.mark.mock_vehicle(speed=10)
def test_what_never_comes_is_a_timeout_that_says_how_it_is(mock_vehicle: RealVehicle) -> None:
    with pytest.raises(TimeoutError, match=r"within 3 s: Truth\(.*armed=False"):
        mock_vehicle.wait_until(lambda truth: truth.armed, timeout_s=3.0)


@pytest.mark.mock_vehicle(speed=10)
async def test_other_tasks_run_while_a_test_waits(mock_vehicle: RealVehicle) -> None:
    ticks = 0

    async def tick() -> None:
        nonlocal ticks
        while True:
            ticks += 1
            await asyncio.sleep(0.001)

    async with asyncio.TaskGroup() as tasks:
        ticking = tasks.create_task(tick())
        await mock_vehicle.wait_until_async(lambda truth: truth.time_s > 1.0)
        with pytest.raises(TimeoutError):
            await mock_vehicle.wait_until_async(lambda truth: truth.armed, timeout_s=0.1)
        ticking.cancel()
    assert ticks > 3


def test_the_end_frees_thread_and_ports() -> None:
    with launch(Plan(vehicles=2)) as swarm:
        assert isinstance(swarm, RealSwarm)
        addresses = [vehicle.address for vehicle in swarm]
        assert "mock-vehicle" in {thread.name for thread in threading.enumerate()}
    assert "mock-vehicle" not in {thread.name for thread in threading.enumerate()}
    for address in addresses:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(address)


@pytest.mark.mock_vehicle(faults=["fleet@0.1"])
def test_nobody_waits_for_a_dead_mock(mock_vehicle: RealVehicle) -> None:
    with pytest.raises(RuntimeError, match="fly no more"):
        mock_vehicle.wait_until(lambda truth: truth.armed)


def test_two_free_ports_differ(free_udp_port: int) -> None:
    with launch(Plan()) as swarm:
        (vehicle,) = swarm
        assert isinstance(vehicle, RealVehicle)
        assert vehicle.port != free_udp_port


def test_a_second_start_costs_little() -> None:
    def start() -> float:
        began_s = time.process_time()
        with launch(Plan()) as swarm:
            (vehicle,) = swarm
            assert isinstance(vehicle, RealVehicle)
            client = Client(vehicle.port)
            client.hear()
            cost_s = time.process_time() - began_s
            client.socket.close()
        return cost_s

    start()
    assert min(start() for _ in range(3)) < 0.2  # processor time; 0.02 s when it was written


# As users meet it: a project of their own, and a pytest of its own.


def test_the_marker_is_explained(pytester: pytest.Pytester) -> None:
    result = pytester.runpytest_subprocess("--markers")
    result.stdout.fnmatch_lines(["@pytest.mark.mock_vehicle(autopilot='px4'*"])


def test_the_nearest_marker_has_the_last_word(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest
        pytestmark = pytest.mark.mock_vehicle(autopilot="ardupilot", time="virtual", sysid=3)

        @pytest.mark.mock_vehicle(sysid=9)
        class TestVehicle:
            def test_class(self, mock_vehicle):
                assert (mock_vehicle.autopilot, mock_vehicle.sysid) == ("ardupilot", 9)

            @pytest.mark.mock_vehicle(autopilot="px4")
            def test_function(self, mock_vehicle):
                assert (mock_vehicle.autopilot, mock_vehicle.sysid) == ("px4", 9)
    """)
    pytester.runpytest_subprocess().assert_outcomes(passed=2)


def test_a_mistake_in_a_marker_is_one_sentence(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        import pytest

        @pytest.mark.mock_vehicle(autopilt="px4")
        def test_1(mock_vehicle): ...

        @pytest.mark.mock_vehicle("px4")
        def test_2(mock_vehicle): ...

        @pytest.mark.mock_vehicle(world="none.yaml")
        def test_3(mock_vehicle): ...

        @pytest.mark.mock_vehicle(vehicles=3)
        def test_4(mock_vehicle): ...

        @pytest.mark.mock_vehicle(faults=["daed:1@3"])
        def test_5(mock_swarm): ...
    """)
    result = pytester.runpytest_subprocess()
    result.assert_outcomes(errors=5)
    result.stdout.fnmatch_lines(
        [
            "mock_vehicle: unknown argument autopilt; did you mean autopilot?",
            "mock_vehicle: the marker takes arguments by name, not 'px4'",
            "mock_vehicle: *none.yaml: cannot be read: No such file or directory",
            "mock_vehicle: flies one vehicle; the fixture mock_swarm flies several",
            "mock_swarm: fault daed:1@3: 'daed' is no fault; did you mean 'dead'?",
        ]
    )
    result.stdout.no_fnmatch_line("*another exception*")
    result.stdout.no_fnmatch_line("*Traceback*")


def test_who_does_not_use_it_does_not_load_it() -> None:
    code = "import sys, mock_vehicle.pytest_plugin; print(*sys.modules)"
    loaded = subprocess.check_output([sys.executable, "-c", code], text=True).split()
    assert "mock_vehicle.pytest_plugin" in loaded
    assert not HEAVY & set(loaded)
