from __future__ import annotations

import math

import numpy as np
import pytest
from mock_client import (
    AP_GUIDED,
    AP_RTL,
    NAN,
    POSITION,
    PX4_LOITER,
    PX4_POSCTL,
    PX4_RTL,
    VELOCITY,
    Client,
    airborne,
    both,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.autopilot import ardupilot_traits, px4_traits
from mock_vehicle.dynamics import Dynamics
from mock_vehicle.vehicle import LIMITS, Personality


def change(client: Client, **parameters: float) -> None:
    """Set REAL32 parameters over the link; ArduPilot takes its integers that way, too."""
    for name, value in parameters.items():
        message = mavlink.MAVLink_param_set_message(7, 1, name.encode(), value, 9)
        client.send(message)
        assert client.vehicle.autopilot.parameters[name] == pytest.approx(value)


@both
def test_the_default_parameters_are_the_recorded_numbers(personality: Personality) -> None:
    recorded = px4_traits.TRAITS if personality == "px4" else ardupilot_traits.TRAITS
    assert Client(personality).vehicle.autopilot.traits == recorded


@both
def test_vehicles_with_equal_parameters_share_what_they_decide(personality: Personality) -> None:
    one, other = Client(personality).vehicle.autopilot, Client(personality).vehicle.autopilot
    assert one.traits is other.traits
    assert one.boot is other.boot
    assert one.fence_settings is other.fence_settings
    name, value = ("COM_OF_LOSS_T", 2.0) if personality == "px4" else ("GUID_TIMEOUT", 6.0)
    before_s = one.traits.setpoint_timeout_s
    one.set_parameter(name, value)
    assert one.traits.setpoint_timeout_s == pytest.approx(2.0 * before_s)
    assert other.traits.setpoint_timeout_s == before_s


# Time.


@pytest.mark.parametrize("timeout_s", [0.5, 3.0])
def test_px4_waits_for_setpoints_as_long_as_com_of_loss_t_says(timeout_s: float) -> None:
    client = airborne("px4")
    change(client, COM_OF_LOSS_T=timeout_s)
    client.fly(2.0, vx=1.0)
    lost_s = client.fly_until(lambda: client.vehicle.mode == PX4_POSCTL)
    assert lost_s == pytest.approx(timeout_s, abs=0.11)


@pytest.mark.parametrize("timeout_s", [1.0, 5.0])
def test_ardupilot_flies_a_velocity_as_long_as_guid_timeout_says(timeout_s: float) -> None:
    client = airborne("ardupilot")
    change(client, GUID_TIMEOUT=timeout_s)
    client.fly(4.0, vx=2.0)
    client.fly(timeout_s - 0.2)
    assert client.velocity[0] == pytest.approx(2.0, abs=0.1)
    client.fly(2.0)
    assert client.velocity[0] < 0.3


@pytest.mark.parametrize(
    ("personality", "name", "wait_s"),
    [("px4", "COM_DISARM_PRFLT", 4.0), ("ardupilot", "DISARM_DELAY", 4.0)],
)
def test_an_idle_vehicle_disarms_after_its_delay_and_never_for_zero(
    personality: Personality, name: str, wait_s: float
) -> None:
    client = Client(personality)
    client.fly(1.5)
    if personality == "ardupilot":
        client.set_mode(AP_GUIDED)
    change(client, **{name: wait_s})
    client.command(400, 1)
    assert client.fly_until(lambda: not client.vehicle.armed) == pytest.approx(wait_s, abs=0.3)
    change(client, **{name: 0.0})
    client.command(400, 1)
    client.fly(60.0)
    assert client.vehicle.armed


def test_px4_disarms_as_late_after_a_landing_as_com_disarm_land_says() -> None:
    client = airborne("px4", 2.0)
    change(client, COM_DISARM_LAND=6.0)
    client.command(21)
    client.fly_until(lambda: client.landed_states[-1] == 1)
    assert client.fly_until(lambda: not client.vehicle.armed) == pytest.approx(6.0, abs=0.3)


# Take-off and landing.


def test_px4_takes_off_to_mis_takeoff_alt_when_no_height_is_given() -> None:
    client = Client("px4")
    change(client, MIS_TAKEOFF_ALT=6.0)
    client.fly(1.5)
    client.command(22, *(NAN,) * 7)
    client.command(400, 1)
    client.fly_until(lambda: client.vehicle.mode == PX4_LOITER)
    client.fly(3.0)
    assert client.height_m == pytest.approx(6.0, abs=0.3)


@pytest.mark.parametrize(("speed_m_s", "took_s"), [(0.75, 15.7), (1.5, 10.0), (3.0, 7.3)])
def test_px4_climbs_as_fast_as_mpc_tko_speed_says(speed_m_s: float, took_s: float) -> None:
    client = Client("px4")
    change(client, MPC_TKO_SPEED=speed_m_s)
    client.fly(1.5)
    client.command(22, *(NAN,) * 6, client.amsl_m(10.0))
    client.command(400, 1)
    assert client.fly_until(lambda: client.height_m > 8.0) == pytest.approx(took_s, abs=1.0)


@pytest.mark.parametrize(
    ("personality", "name", "value", "speed_m_s"),
    [
        ("px4", "MPC_LAND_SPEED", 0.4, 0.4),
        ("px4", "MPC_LAND_SPEED", 1.0, 1.0),
        ("ardupilot", "LAND_SPEED", 100.0, 1.0),
        ("ardupilot", "LAND_SPEED", 30.0, 0.3),
    ],
)
def test_a_landing_is_as_fast_as_its_parameter_says(
    personality: Personality, name: str, value: float, speed_m_s: float
) -> None:
    client = airborne(personality, 4.0)
    change(client, **{name: value})
    client.command(21)
    client.fly(2.5)
    assert client.velocity[2] == pytest.approx(speed_m_s, abs=0.05)


# Speed.


@pytest.mark.parametrize(
    ("name", "value", "asked", "reached"),
    [
        ("MPC_XY_VEL_MAX", 3.0, {"vx": 6.0}, (3.0, 0.0)),
        ("MPC_Z_VEL_MAX_UP", 1.0, {"vz": -2.0}, (0.0, -1.0)),
        ("MPC_Z_VEL_MAX_DN", 0.4, {"vz": 2.0}, (0.0, 0.4)),
    ],
)
def test_px4_flies_no_faster_than_its_parameters_say(
    name: str, value: float, asked: dict[str, float], reached: tuple[float, float]
) -> None:
    client = airborne("px4")
    change(client, **{name: value})
    client.fly(8.0, **asked)
    north, _, down = client.velocity
    assert (north, down) == pytest.approx(reached, abs=0.15)


def test_wpnav_speed_limits_positions_of_ardupilot_and_not_velocities() -> None:
    client = airborne("ardupilot")
    change(client, WPNAV_SPEED=300.0)
    client.fly(8.0, vx=6.0)
    assert client.velocity[0] == pytest.approx(6.0, abs=0.2)
    client.fly(4.0, vx=0.0)
    north = client.vehicle.autopilot.state.north_m
    client.setpoint(mask=POSITION, x=north + 40.0, z=-5.0)
    speeds = []
    for _ in range(100):
        client.tick()
        speeds.append(client.velocity[0])
    assert max(speeds) == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize(("z", "name", "value"), [(-25, "UP", 100.0), (-1, "DN", 50.0)])
def test_wpnav_speed_up_and_down_limit_vertical_moves(z: float, name: str, value: float) -> None:
    client = airborne("ardupilot", 12.0)
    change(client, **{f"WPNAV_SPEED_{name}": value})
    client.setpoint(mask=POSITION, z=z)
    client.fly(5.0)
    assert abs(client.velocity[2]) == pytest.approx(value / 100.0, abs=0.1)


def test_a_stiffer_position_loop_of_px4_flies_faster() -> None:
    def speed(gain: float) -> float:
        client = airborne("px4")
        change(client, MPC_XY_P=gain)
        client.fly(1.5, mask=POSITION, x=4.0, z=-5.0)
        return float(client.velocity[0])

    assert speed(1.5) > 1.1 * speed(0.95)


def test_new_limits_of_one_vehicle_leave_the_others_as_they_are() -> None:
    def fly(*, relimits: bool) -> np.ndarray:
        limits = LIMITS["px4"]
        dynamics = Dynamics(2, [[0, 0, -5], [9, 9, -5]], [0, 0], [limits, limits])
        dynamics.control[:] = 1
        for step in range(200):
            dynamics.target_velocity_ned_m_s[:] = (5.0 if step < 100 else -5.0, 0.0, 0.0)
            if relimits and step == 50:
                dynamics.relimit(0, slow.limits)
            dynamics.step(0.02, (0.0, 0.0, 0.0))
        return dynamics.velocity_ned_m_s

    slow = Client("px4", parameters={"MPC_XY_VEL_MAX": 1.0}).vehicle.autopilot.traits
    changed, unchanged = fly(relimits=True), fly(relimits=False)
    assert changed[1] == pytest.approx(unchanged[1], abs=0.0)
    assert changed[0, 0] > unchanged[0, 0] + 2.0


# The way home.


@pytest.mark.parametrize(
    ("personality", "name", "value", "north_m", "height_m"),
    [
        ("px4", "RTL_RETURN_ALT", 12.0, 14.0, 12.0),
        ("px4", "RTL_RETURN_ALT", 12.0, 8.0, 8.0),  # the cone of 45 deg near home
        ("px4", "RTL_RETURN_ALT", 3.0, 14.0, 5.0),
        ("ardupilot", "RTL_ALT", 1500, 8.0, 15.0),
        ("ardupilot", "RTL_ALT", 1500, 3.0, 9.0),  # its cone is steeper
        ("ardupilot", "RTL_ALT", 1000, 8.0, 10.0),
        ("ardupilot", "RTL_ALT", 0, 8.0, 5.0),
    ],
)
def test_a_return_climbs_to_its_height_first(
    personality: Personality, name: str, value: float, north_m: float, height_m: float
) -> None:
    client = airborne(personality)
    change(client, **{name: value})
    client.fly_until(
        lambda: client.vehicle.autopilot.state.north_m > north_m - 0.3,
        mask=POSITION,
        x=north_m,
        z=-5.0,
    )
    client.fly(4.0, mask=POSITION, x=north_m, z=-5.0)
    client.command(20)
    assert client.vehicle.mode == (PX4_RTL if personality == "px4" else AP_RTL)
    flown = [(0.0, 0.0)]
    while client.vehicle.armed:
        client.tick()
        assert client.now < 200.0
        flown.append((client.vehicle.autopilot.state.north_m, client.height_m))
    top_m = max(height for _, height in flown)
    assert top_m == pytest.approx(height_m, abs=0.7)
    on_its_way = [height for north, height in flown[1:] if 1.5 < north < north_m - 1.5]
    assert on_its_way == pytest.approx([height_m] * len(on_its_way), abs=0.8)
    assert flown[-1][0] == pytest.approx(0.0, abs=0.7)


def test_ardupilot_waits_above_home_for_rtl_loit_time() -> None:
    def took_s(loiter_ms: float) -> float:
        client = airborne("ardupilot")
        change(client, RTL_LOIT_TIME=loiter_ms, RTL_ALT=0)
        client.command(20)
        return client.fly_until(lambda: not client.vehicle.armed)

    assert took_s(10_000) - took_s(1_000) == pytest.approx(9.0, abs=0.2)


# Nonsense.


@both
@pytest.mark.parametrize("value", [NAN, math.inf, -1e30, -1.0, 0.0, 1e30])
def test_no_value_of_a_parameter_breaks_a_flight(personality: Personality, value: float) -> None:
    client = airborne(personality)
    autopilot = client.vehicle.autopilot
    stored, service = autopilot.parameters, autopilot.parameter_service
    for name in stored:
        if name != autopilot.dialect.sysid:
            kind = stored.kind(name)
            number = value if kind == 9 or personality == "ardupilot" else 7e-45  # an int32 of 5
            service.change(autopilot, name, number, kind, client.now)
    client.fly(3.0, vx=1.0, vz=-0.5)
    client.fly(2.0, mask=POSITION, x=1.0, z=-5.0)
    client.command(21)
    client.fly(2.0)
    client.command(20)
    client.fly(5.0, mask=VELOCITY, vx=1.0)
    assert np.isfinite(client.dynamics.position_ned_m).all()
