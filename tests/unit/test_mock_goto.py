from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from mock_client import (
    ACCEPTED,
    AP_GUIDED,
    AP_LAND,
    DENIED,
    FAILED,
    NAN,
    PX4_LOITER,
    PX4_OFFBOARD,
    PX4_POSCTL,
    UNSUPPORTED,
    Client,
    airborne,
    both,
)
from mock_planner import GLOBAL, GLOBAL_INT, INT_MAX, REL, REL_INT, Planner, waypoint
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.vehicle import Personality

POSITION, VELOCITY, NO_FRAME = 0xDF8, 0xDC7, 99


def e7(client: Client, north_m: float, east_m: float) -> tuple[int, int]:
    there = client.vehicle.autopilot.origin.to_global(north_m, east_m, 0.0)
    return round(there.latitude_deg * 1e7), round(there.longitude_deg * 1e7)


def reposition(
    client: Client, frame: int, x: int, y: int, z: float, *p: float
) -> list[tuple[int, int]]:
    """DO_REPOSITION as a COMMAND_INT; p is -1 (speed), 1 (change the mode), 0, yaw."""
    p1, p2, p3, p4 = (*p, *(-1.0, 1.0, 0.0, 0.0)[len(p) :])
    make = mavlink.MAVLink_command_int_message
    client.send(make(7, 1, frame, 192, 0, 0, p1, p2, p3, p4, x, y, z))
    return [(ack.command, ack.result) for ack in client.tick("COMMAND_ACK")]


def setpoint(client: Client, frame: int, mask: int, place: Any, **v: float) -> None:
    speeds = [v.get(name, 0.0) for name in ("vx", "vy", "vz")]
    rest = (*place, *speeds, 0.0, 0.0, 0.0, 0.0, 0.0)
    make: Any = mavlink.MAVLink_set_position_target_global_int_message
    client.send(make(0, 7, 1, frame, mask, *rest))


def local(client: Client) -> list[float]:
    s = client.vehicle.autopilot.state
    return [s.north_m, s.east_m, -s.down_m]


# DO_REPOSITION.


def test_px4_repositions_by_both_commands_at_an_amsl_altitude() -> None:
    client = airborne("px4")
    x, y = e7(client, 20.0, 0.0)
    assert reposition(client, GLOBAL_INT, x, y, client.amsl_m(12.0)) == [(192, ACCEPTED)]
    assert client.vehicle.mode == PX4_LOITER
    took_s = client.fly_until(lambda: math.dist(local(client), (20.0, 0.0, 12.0)) < 0.7)
    assert took_s == pytest.approx(7.7, abs=1.0)
    place = (e * 1e-7 for e in e7(client, 20.0, 9.0))
    assert client.command(192, -1, 1, 0, NAN, *place, client.amsl_m(12.0)) == [(192, ACCEPTED)]
    client.fly(12.0)
    assert local(client) == pytest.approx([20.0, 9.0, 12.0], abs=0.4)


def test_px4_repositions_to_what_is_given_and_keeps_the_rest() -> None:
    client = airborne("px4")
    assert reposition(client, GLOBAL_INT, INT_MAX, INT_MAX, client.amsl_m(9.0)) == [(192, ACCEPTED)]
    client.fly(10.0)
    assert local(client) == pytest.approx([0.0, 0.0, 9.0], abs=0.4)
    client.command(192, 1.0, 1, 0, 0.0, *(e * 1e-7 for e in e7(client, 30.0, 0.0)), NAN)
    client.fly(6.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.2), "param1 is a speed"
    assert client.dynamics.yaw_rad[0] == pytest.approx(0.0, abs=0.05), "param4 is a yaw"
    assert client.command(192, -1, 0) == [(192, UNSUPPORTED)], "it does not ask for the mode"


def test_px4_accepts_a_reposition_of_nothing_on_the_ground() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.command(192, -1, 1, 0, *(NAN,) * 4) == [(192, ACCEPTED)]
    assert client.command(34, 5, 1, 0, 0, *(NAN,) * 3) == [(34, ACCEPTED)]
    client.fly(3.0)
    assert client.height_m == 0.0


def test_ardupilot_repositions_by_command_int_alone() -> None:
    client = airborne("ardupilot")
    x, y = e7(client, 10.0, -5.0)
    assert client.command(192, -1, 1, 0, 0, x * 1e-7, y * 1e-7, 8.0) == [(192, UNSUPPORTED)]
    assert reposition(client, NO_FRAME, x, y, 8.0) == [(192, DENIED)]
    assert client.texts[-1] == "Unknown mavlink coordinate frame 99"
    assert reposition(client, REL_INT, x, y, NAN) == [(192, DENIED)]
    assert reposition(client, REL_INT, 990000000, y, 8.0) == [(192, DENIED)]
    assert reposition(client, REL_INT, x, y, 8.0) == [(192, ACCEPTED)]
    client.fly(14.0)
    assert local(client) == pytest.approx([10.0, -5.0, 8.0], abs=0.3)
    assert reposition(client, GLOBAL, x, y, client.amsl_m(5.0)) == [(192, ACCEPTED)]
    client.fly(8.0)
    assert local(client) == pytest.approx([10.0, -5.0, 5.0], abs=0.3)


def test_ardupilot_changes_to_guided_for_a_reposition_only_if_asked() -> None:
    client = airborne("ardupilot")
    x, y = e7(client, 10.0, 0.0)
    client.set_mode(AP_LAND)
    assert reposition(client, REL_INT, x, y, 5.0, -1.0, 0.0) == [(192, DENIED)]
    assert reposition(client, REL_INT, x, y, 5.0, -1.0, 1.0) == [(192, ACCEPTED)]
    assert client.vehicle.mode == AP_GUIDED


# Speeds and headings.


@both
def test_a_speed_holds_for_the_flight_to_a_place(personality: Personality) -> None:
    client = airborne(personality)
    client.set_mode(PX4_LOITER if personality == "px4" else AP_GUIDED)
    assert client.command(178, 1, 2.0, -1) == [(178, ACCEPTED)]
    reposition(client, GLOBAL_INT, *e7(client, 50.0, 0.0), client.amsl_m(5.0))
    client.fly(5.0)
    assert client.velocity[0] == pytest.approx(2.0, abs=0.25)


def test_ardupilot_slows_position_setpoints_but_no_velocities() -> None:
    client = airborne("ardupilot")
    assert client.command(178, 9, 2.0) == [(178, FAILED)]
    assert client.command(178, 1, NAN) == [(178, FAILED)]
    client.command(178, 1, 2.0, -1)
    client.setpoint(POSITION, x=60.0, z=-5.0)
    client.fly(5.0)
    assert client.velocity[0] == pytest.approx(2.0, abs=0.1)
    client.fly(4.0, vx=4.0)
    assert client.velocity[0] == pytest.approx(4.0, abs=0.2)


def test_ardupilot_turns_by_condition_yaw() -> None:
    client = airborne("ardupilot")
    assert client.command(115, 90, 20, 1, 0) == [(115, ACCEPTED)]
    client.fly(4.0)
    assert client.dynamics.yaw_rad[0] == pytest.approx(math.pi / 2, abs=0.03)
    client.command(115, 30, 20, -1, 1)
    client.fly(4.0)
    assert client.dynamics.yaw_rad[0] == pytest.approx(math.pi / 3, abs=0.03)
    assert client.command(115, NAN) == [(115, FAILED)]


# Guided items.


def test_a_guided_item_is_a_goto_of_ardupilot() -> None:
    planner = Planner("ardupilot")
    client = planner.client
    x, y = e7(client, 12.0, 3.0)
    goto = waypoint(frame=REL, x=x, y=y, z=7.0, current=2)
    assert planner.item(0, goto)[0].type == 1, "it is not in GUIDED"
    client.take_off(5.0)
    (ack,) = [m for m in planner.item(0, goto, floats=True) if m.get_type() == "MISSION_ACK"]
    assert ack.type == 0
    client.fly(12.0)
    assert local(client) == pytest.approx([12.0, 3.0, 7.0], abs=1.0)
    assert planner.item(0, waypoint(z=4.0, current=3))[0].type == 0
    client.fly(8.0)
    assert local(client) == pytest.approx([12.0, 3.0, 4.0], abs=1.0)
    assert planner.item(0, waypoint(frame=99, current=2))[0].type == 2


def test_a_guided_item_is_nothing_to_px4() -> None:
    planner = Planner("px4")
    assert not planner.item(0, waypoint(current=2))


# SET_POSITION_TARGET_GLOBAL_INT.


@pytest.mark.parametrize("frame", [GLOBAL, REL, GLOBAL_INT, REL_INT, 11])
@both
def test_a_place_on_the_globe_is_flown_to(personality: Personality, frame: int) -> None:
    client = airborne(personality)
    is_amsl = frame in {GLOBAL, GLOBAL_INT}
    height = client.amsl_m(8.0) if is_amsl else 8.0
    place = (*e7(client, 6.0, 4.0), height)
    client.before_tick = lambda: setpoint(client, frame, POSITION, place)
    client.fly(10.0)
    assert local(client) == pytest.approx([6.0, 4.0, 8.0], abs=0.4)


@both
def test_a_velocity_may_come_in_a_global_frame(personality: Personality) -> None:
    client = airborne(personality)
    client.before_tick = lambda: setpoint(client, GLOBAL_INT, VELOCITY, (0, 0, 0.0), vx=1.0)
    client.fly(5.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


def test_px4_knows_no_local_frame_in_a_global_setpoint() -> None:
    client = airborne("px4")
    client.gcs_heartbeat()
    client.before_tick = lambda: setpoint(client, 1, POSITION, (0, 0, 5.0))
    client.fly(2.0)
    assert "".join(client.texts).startswith(
        "SET_POSITION_TARGET_GLOBAL_INT coordinate frame 1 unsupported"
    )
    assert client.vehicle.mode == PX4_POSCTL, "it was no setpoint"


@both
def test_a_global_setpoint_of_nans_is_survived(personality: Personality) -> None:
    client = airborne(personality)
    for place in ((INT_MAX, INT_MAX, NAN), (0, 0, math.inf), (-INT_MAX, 0, 1e30)):
        setpoint(client, GLOBAL_INT, POSITION, place)
        client.fly(0.5)
    assert all(map(math.isfinite, local(client)))


# SET_ATTITUDE_TARGET.


def lean(client: Client, pitch_rad: float, thrust: float = 0.5, mask: int = 7) -> None:
    q = [math.cos(pitch_rad / 2), 0.0, math.sin(pitch_rad / 2), 0.0]
    message = mavlink.MAVLink_set_attitude_target_message(0, 7, 1, mask, q, 0.0, 0.0, 0.0, thrust)
    client.send(message)


@both
def test_leaning_forward_accelerates_and_thrust_climbs(personality: Personality) -> None:
    client = airborne(personality)
    client.before_tick = lambda: lean(client, -0.1)
    client.fly(2.0)
    assert client.velocity[0] == pytest.approx(1.3, abs=0.6)
    assert client.velocity[2] == pytest.approx(0.0, abs=0.15)
    client.before_tick = lambda: lean(client, 0.0, thrust=0.7)
    client.fly(3.0)
    assert client.velocity[2] < -0.5
    assert client.vehicle.mode == (PX4_OFFBOARD if personality == "px4" else AP_GUIDED)


@both
def test_an_attitude_of_nans_is_survived(personality: Personality) -> None:
    client = airborne(personality)
    for pitch, thrust, mask in ((NAN, 0.5, 7), (0.0, NAN, 7), (0.0, 0.5, 0xFF), (math.pi, 9.0, 7)):
        if not math.isnan(pitch):
            lean(client, pitch, thrust, mask)
        else:
            q = [NAN] * 4
            make = mavlink.MAVLink_set_attitude_target_message
            client.send(make(0, 7, 1, mask, q, 0.0, 0.0, 0.0, thrust))
        client.fly(0.5)
    assert all(map(math.isfinite, local(client)))


# DO_ORBIT.


def test_px4_circles_a_place() -> None:
    client = airborne("px4", 8.0)
    centre = (e * 1e-7 for e in e7(client, 10.0, 0.0))
    assert client.command(34, -8.0, 2.0, 0, 0, *centre, NAN) == [(34, ACCEPTED)]
    client.fly(15.0)
    bearings = []
    for _ in range(40):
        client.fly(0.5)
        north, east, height = local(client)
        assert math.hypot(north - 10.0, east) == pytest.approx(8.0, abs=0.8)
        assert height == pytest.approx(8.0, abs=0.4)
        bearings.append(math.atan2(east, north - 10.0))
    turned = sum(math.remainder(b - a, math.tau) for a, b in pairwise(bearings))
    assert turned == pytest.approx(-19.5 * 2.0 / 8.0, rel=0.15), "a negative radius is to the left"
