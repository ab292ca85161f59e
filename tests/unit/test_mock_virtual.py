"""Vehicles in a test's own process, in virtual time."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.testing import Plan, VirtualSwarm, VirtualVehicle, launch

GUIDED = 4
TAKEOFF, SET_MODE, ARM = 22, 176, 400
virtual = pytest.mark.mock_vehicle(time="virtual")


def command(number: int, *params: float, sysid: int = 1, key: bytes = b"") -> bytes:
    seven = (*params, *(0.0,) * 7)[:7]
    message = mavlink.MAVLink_command_long_message(sysid, 1, number, 0, *seven)
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    if key:
        codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    return bytes(message.pack(codec))


def take_off(vehicle: VirtualVehicle, height_m: float) -> None:
    vehicle.send(command(SET_MODE, 1, GUIDED))
    vehicle.send(command(ARM, 1))
    vehicle.send(command(TAKEOFF, 0, 0, 0, 0, 0, 0, height_m))


@pytest.mark.mock_vehicle(autopilot="ardupilot", time="virtual")
def test_a_vehicle_takes_off_when_the_test_says_so(mock_vehicle: VirtualVehicle) -> None:
    mock_vehicle.fly(seconds=1.0)
    assert mock_vehicle.truth.ready_to_arm
    take_off(mock_vehicle, height_m=5.0)
    acknowledged = [m for m in mock_vehicle.receive_messages() if m.name == "COMMAND_ACK"]
    assert [(ack.values.command, ack.values.result) for ack in acknowledged] == [
        (SET_MODE, 0),
        (ARM, 0),
        (TAKEOFF, 0),
    ]
    truth = mock_vehicle.fly_until(lambda truth: truth.height_m > 4.5)
    assert (truth.armed, truth.landed, truth.mode) == (True, False, "GUIDED")
    assert truth.distance_to_home_m < 0.5
    assert 4.0 < truth.time_s < 12.0


@virtual
def test_what_the_client_sent_is_noted_with_its_time(mock_vehicle: VirtualVehicle) -> None:
    mock_vehicle.fly(0.5)
    mock_vehicle.send(command(ARM, 1))
    heard = mock_vehicle.received("COMMAND_LONG")
    assert [(m.time_s, m.sysid, m.compid, m.values.command) for m in heard] == [
        (0.5, 255, 190, ARM)
    ]
    assert mock_vehicle.received("HEARTBEAT") == []
    assert mock_vehicle.received() == heard


@virtual
def test_a_fault_strikes_at_once(mock_vehicle: VirtualVehicle) -> None:
    mock_vehicle.fly(1.0)
    assert mock_vehicle.receive()
    mock_vehicle.faults.strike("dead")
    mock_vehicle.fly(1.0)
    assert not mock_vehicle.truth.alive
    assert mock_vehicle.receive() == []


@virtual
def test_a_fault_has_a_duration_and_parameters_and_is_healed(mock_vehicle: VirtualVehicle) -> None:
    def speaks() -> bool:
        mock_vehicle.receive()
        mock_vehicle.fly(0.5)
        return bool(mock_vehicle.receive())

    mock_vehicle.faults.strike("link-loss", duration_s=1.2, direction="downlink")
    assert [speaks() for _ in range(3)] == [False, False, True]
    mock_vehicle.faults.strike("link-loss")
    mock_vehicle.faults.heal("freeze")
    assert not speaks()
    mock_vehicle.faults.heal("link-loss")
    assert speaks()


@virtual
def test_a_parameter_that_a_fault_does_not_have_names_the_nearest(
    mock_vehicle: VirtualVehicle,
) -> None:
    with pytest.raises(ValueError, match="did you mean 'delay_s'"):
        mock_vehicle.faults.strike("link-delay", delay=0.3)


@virtual
def test_a_fault_that_is_none_names_the_nearest(mock_vehicle: VirtualVehicle) -> None:
    with pytest.raises(ValueError, match="did you mean 'dead'"):
        mock_vehicle.faults.strike("daed")


@pytest.mark.mock_vehicle(time="virtual", faults=["battery:1@2"])
def test_planned_faults_come_at_their_time(mock_vehicle: VirtualVehicle) -> None:
    mock_vehicle.fly(1.9)
    assert mock_vehicle.truth.battery_fraction > 0.9
    mock_vehicle.fly_until(lambda truth: truth.battery_fraction < 0.2, within_s=0.5)


@pytest.mark.mock_vehicle(time="virtual", parameters={"MIS_TAKEOFF_ALT": 4.0})
def test_parameters_are_as_the_test_says(mock_vehicle: VirtualVehicle) -> None:
    assert mock_vehicle.parameters["MIS_TAKEOFF_ALT"] == 4.0
    mock_vehicle.fly(0.1)
    mock_vehicle.send(command(TAKEOFF, *(math.nan,) * 7))
    mock_vehicle.send(command(ARM, 1))
    mock_vehicle.fly(20.0)
    assert mock_vehicle.truth.height_m == pytest.approx(4.0, abs=0.4)


def test_a_parameter_that_is_none_names_the_nearest() -> None:
    plan = Plan(time="virtual", parameters={"MIS_TAKEOF_ALT": 4.0})
    with pytest.raises(MockVehicleError, match="perhaps MIS_TAKEOFF_ALT"), launch(plan):
        pytest.fail("it flies")


@pytest.mark.mock_vehicle(time="virtual", signing_key="hush")
def test_a_vehicle_with_a_key_obeys_who_signs(mock_vehicle: VirtualVehicle) -> None:
    mock_vehicle.fly(1.0)
    mock_vehicle.send(command(ARM, 1))
    assert (mock_vehicle.refused, mock_vehicle.truth.armed) == (1, False)
    mock_vehicle.send(command(ARM, 1, key=hashlib.sha256(b"hush").digest()))
    assert (mock_vehicle.refused, mock_vehicle.truth.armed) == (1, True)


@virtual
def test_what_never_comes_is_a_timeout_that_says_how_it_is(mock_vehicle: VirtualVehicle) -> None:
    with pytest.raises(TimeoutError, match=r"within 2 s: Truth\(time_s=2.*armed=False"):
        mock_vehicle.fly_until(lambda truth: truth.armed, within_s=2.0)


def test_the_same_seed_flies_the_same_bytes() -> None:
    def record(seed: int) -> list[bytes]:
        plan = Plan(autopilot="ardupilot", time="virtual", seed=seed)
        with launch(plan) as swarm:
            vehicle = swarm[1]
            assert isinstance(vehicle, VirtualVehicle)
            vehicle.send(command(511, 32, 100_000))
            take_off(vehicle, height_m=2.0)
            vehicle.fly(5.0)
            return vehicle.receive()

    assert len(record(1)) > 50
    assert record(1) == record(1)


@pytest.mark.mock_vehicle(time="virtual", vehicles=3, sysid=7, autopilot="mixed", seed=3)
def test_a_swarm_is_found_by_sysid(mock_swarm: VirtualSwarm) -> None:
    assert mock_swarm.sysids == [7, 8, 9]
    assert [vehicle.autopilot for vehicle in mock_swarm] == ["px4", "ardupilot", "px4"]
    mock_swarm.fly(1.0)
    take_off(mock_swarm[8], height_m=3.0)  # to sysid 1, who is not there
    mock_swarm[8].send(command(SET_MODE, 1, GUIDED, sysid=8) + command(ARM, 1, sysid=8))
    truths = mock_swarm.fly_until(lambda truths: truths[1].armed)
    assert [truth.armed for truth in truths] == [False, True, False]


@virtual
def test_the_open_field_is_a_place_on_the_globe(mock_vehicle: VirtualVehicle) -> None:
    truth = mock_vehicle.truth
    assert (truth.latitude_deg, truth.longitude_deg) == pytest.approx((47.3977418, 8.5455939))
    assert truth.amsl_m == pytest.approx(489.4)
    assert truth.position_ned_m == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("mock_vehicle", ["px4", {"autopilot": "ardupilot"}], indirect=True)
@virtual
def test_one_test_flies_with_both_personalities(mock_vehicle: VirtualVehicle) -> None:
    mock_vehicle.fly(0.1)
    heartbeat = mock_vehicle.receive_messages()[0]
    assert heartbeat.values.autopilot == {"px4": 12, "ardupilot": 3}[mock_vehicle.autopilot]


def test_px4_talks_to_a_ground_station_on_a_link_of_its_own() -> None:
    with launch(Plan(time="virtual")) as swarm:
        vehicle = swarm[1]
        assert isinstance(vehicle, VirtualVehicle)
        vehicle.fly(1.0)
        companion, ground = vehicle.receive_messages(), vehicle.receive_messages(link=1)
        names = [[m.name for m in link].count("ATTITUDE") for link in (companion, ground)]
        assert names == [pytest.approx(100, abs=2), pytest.approx(50, abs=2)]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"autopilt": "px4"}, "unknown argument autopilt; did you mean autopilot?"),
        ({"quux": 1}, "unknown argument quux; known are autopilot, vehicles, world"),
        ({"autopilot": "px5"}, "autopilot should be one of px4, ardupilot, mixed, not 'px5'"),
        ({"time": "fast"}, "time should be one of real, virtual, not 'fast'"),
        ({"vehicles": 0}, "vehicles should be a whole number, 1 to 255, not 0"),
        ({"vehicles": 1.5}, "vehicles should be a whole number, 1 to 255, not 1.5"),
        ({"vehicles": True}, "vehicles should be a whole number, 1 to 255, not True"),
        ({"seed": -1}, "seed should be a whole number, from 0 on, not -1"),
        ({"speed": math.nan}, "speed should be 0.1 to 100, not nan"),
        ({"sysid": 250, "vehicles": 10}, "sysids would end at 259, beyond 255"),
        ({"signing_key": "two\nlines"}, "a key is one line"),
        ({"parameters": 3}, "parameters should be a mapping, not 3"),
        ({"faults": "dead:1@2"}, "faults should be a list, as ['dead:1@2']"),
    ],
)
def test_a_wrong_argument_is_one_sentence(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the sentence is compared
        Plan.of(arguments)
    assert str(caught.value).startswith(sentence)
