from __future__ import annotations

import math

import numpy as np
import pytest
from mock_client import (
    ACCEPTED,
    AP_GUIDED,
    AP_RTL,
    FAILED,
    NAN,
    POSITION,
    PX4_LAND,
    PX4_LOITER,
    PX4_OFFBOARD,
    PX4_POSCTL,
    PX4_RTL,
    PX4_TAKEOFF,
    REJECTED,
    VELOCITY,
    VELOCITY_YAW,
    VELOCITY_YAW_RATE,
    Client,
    airborne,
    both,
)

from mock_vehicle.autopilot import base, px4_setpoints
from mock_vehicle.autopilot.manoeuvres import STOP
from mock_vehicle.vehicle import Personality
from swarm_ctl import wire

# Whole flights.


@both
def test_it_arms_takes_off_flies_lands_and_disarms(personality: Personality) -> None:
    client = airborne(personality)
    assert client.height_m == pytest.approx(5.0, abs=0.4)
    client.fly(5.0, vx=1.0, vy=-0.5)
    assert client.velocity[:2] == pytest.approx([1.0, -0.5], abs=0.15)  # PX4 creeps at the end
    assert client.command(21) == [(21, ACCEPTED)]
    client.fly_until(lambda: not client.vehicle.armed)
    client.fly(1.0)
    assert client.landed_states == [1, 3, 2, 4, 1]
    assert not client.last("HEARTBEAT").base_mode & 128
    assert client.height_m == 0.0


def test_ardupilot_climbs_and_lands_in_the_recorded_time() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.command(511, 245, 100_000)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.command(22, 0, 0, 0, 0, 0, 0, 5.0)
    took_s = client.fly_until(lambda: client.height_m > 1.0)
    took_s += client.fly_until(lambda: client.height_m > 4.5)
    assert took_s == pytest.approx(7.2, abs=0.6)
    client.fly(8.0)
    client.command(21)
    assert client.last("EXTENDED_SYS_STATE").landed_state == 4
    touched_s = client.fly_until(lambda: bool(client.dynamics.on_ground[0]))
    assert touched_s == pytest.approx(10.5, abs=1.0)
    down_s = client.fly_until(lambda: client.landed_states[-1] == 1)
    disarmed_s = client.fly_until(lambda: not client.vehicle.armed)
    assert touched_s + down_s + disarmed_s == pytest.approx(12.8, abs=1.0)
    assert disarmed_s == pytest.approx(0.5, abs=0.15)


def test_px4_climbs_and_lands_in_the_recorded_time() -> None:
    client = Client("px4")
    client.fly(1.5)
    client.command(22, *(NAN,) * 6, client.amsl_m(10.0))
    client.command(400, 1)
    took_s = client.fly_until(lambda: client.height_m > 1.0)
    assert took_s == pytest.approx(5.6, abs=0.6)
    took_s += client.fly_until(lambda: client.height_m > 8.0)
    assert took_s == pytest.approx(11.0, abs=1.0)
    took_s += client.fly_until(lambda: client.vehicle.mode == PX4_LOITER)
    assert took_s == pytest.approx(12.2, abs=1.2)
    client.command(21)
    client.fly_until(lambda: client.landed_states[-1] == 1)
    assert client.fly_until(lambda: not client.vehicle.armed) == pytest.approx(2.0, abs=0.3)
    assert client.vehicle.mode == PX4_LAND


def test_px4_takes_off_by_an_offboard_setpoint() -> None:
    client = Client("px4")
    client.fly(1.5, mask=POSITION, z=-5.0)
    client.set_mode(PX4_OFFBOARD)
    assert client.command(400, 1) == [(400, ACCEPTED)]
    took_s = client.fly_until(lambda: client.height_m > 1.0, mask=POSITION, z=-5.0)
    assert took_s == pytest.approx(4.1, abs=0.5)
    took_s += client.fly_until(lambda: client.height_m > 4.7, mask=POSITION, z=-5.0)
    assert took_s == pytest.approx(6.4, abs=0.9)
    assert client.landed_states == [1, 2]


@both
def test_return_flies_home_and_lands(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(4.0, vx=2.0)
    assert client.dynamics.position_ned_m[0, 0] > 7.0
    assert client.command(20) == [(20, ACCEPTED)]
    client.fly_until(lambda: not client.vehicle.armed)
    assert client.dynamics.position_ned_m[0, :2] == pytest.approx([3.0, -2.0], abs=0.7)
    assert client.vehicle.mode == (PX4_RTL if personality == "px4" else AP_RTL)


# Take-off.


def test_px4_takes_off_to_the_default_height_for_nan_and_does_not_arm() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.command(22, *(NAN,) * 7) == [(22, ACCEPTED)]
    assert client.vehicle.mode == PX4_TAKEOFF
    assert not client.vehicle.armed
    client.command(400, 1)
    client.fly(12.0)
    assert client.height_m == pytest.approx(2.5, abs=0.1)


def test_px4_accepts_a_take_off_at_latitude_zero_and_does_not_climb() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.command(22, 0, 0, 0, 0, 0, 0, 5.0) == [(22, ACCEPTED)]
    client.command(400, 1)
    client.fly(15.0)
    assert client.height_m < 0.1


def test_ardupilot_takes_off_only_in_guided_and_armed_and_once() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    five = (0, 0, 0, 0, 0, 0, 5.0)
    client.set_mode(AP_GUIDED)
    assert client.command(22, *five) == [(22, FAILED)]
    client.command(400, 1)
    assert client.command(22, *five[:6], NAN) == [(22, FAILED)]
    client.set_mode(2)
    assert client.command(22, *five) == [(22, FAILED)]
    client.set_mode(AP_GUIDED)
    assert client.command(22, *five) == [(22, ACCEPTED)]
    client.fly(6.0)
    assert client.command(22, *five) == [(22, FAILED)]


def test_a_velocity_setpoint_right_after_the_take_off_cancels_it_on_ardupilot() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.command(22, 0, 0, 0, 0, 0, 0, 5.0)
    client.fly(12.0, vx=0.0, vz=-1.0)
    assert client.height_m == 0.0
    assert not client.vehicle.armed


def test_a_setpoint_during_the_climb_stops_it_there_on_ardupilot() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.command(22, 0, 0, 0, 0, 0, 0, 6.0)
    client.fly_until(lambda: client.height_m > 2.0)
    client.fly(5.0, vx=0.0)
    assert 2.5 < client.height_m < 4.5  # recorded 3.9


def test_ardupilot_setpoints_do_nothing_on_the_ground() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.fly(8.0, vz=-2.0)
    assert client.height_m == 0.0


# Setpoints.


def test_px4_needs_setpoints_to_enter_offboard_in_the_air() -> None:
    client = Client("px4")
    client.take_off()
    client.fly(2.0)
    assert client.set_mode(PX4_OFFBOARD) == [(176, ACCEPTED), (176, REJECTED)]
    client.setpoint()
    assert client.set_mode(PX4_OFFBOARD) == [(176, ACCEPTED), (176, ACCEPTED)]


def test_px4_loses_offboard_after_a_second_descends_lands_and_disarms() -> None:
    client = airborne("px4")
    client.fly(2.0, vx=1.0)
    client.gcs_heartbeat()
    lost_s = client.fly_until(lambda: client.vehicle.mode == PX4_POSCTL)
    assert lost_s == pytest.approx(1.1, abs=0.15)
    client.fly(1.0)
    beat = client.last("HEARTBEAT")
    assert (beat.custom_mode, beat.system_status) == (PX4_POSCTL, 5)
    assert "Failsafe activated\t" in client.texts
    client.fly(2.0)
    assert client.velocity == pytest.approx([0.0, 0.0, 0.6], abs=0.1)
    client.fly_until(lambda: not client.vehicle.armed, 30.0)
    assert client.vehicle.mode == PX4_OFFBOARD


def test_px4_resumes_offboard_by_itself_when_setpoints_resume() -> None:
    client = airborne("px4")
    client.fly(3.0)
    assert client.vehicle.mode == PX4_POSCTL
    client.fly(3.0, vx=1.0)
    assert client.vehicle.mode == PX4_OFFBOARD
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


def test_px4_does_not_resume_offboard_when_another_mode_was_chosen() -> None:
    client = airborne("px4")
    client.fly(3.0)
    client.set_mode(PX4_LOITER)
    client.fly(2.0, vx=1.0)
    assert client.vehicle.mode == PX4_LOITER


def test_ardupilot_brakes_after_three_seconds_and_stays_in_guided() -> None:
    client = airborne("ardupilot")
    client.fly(4.0, vx=2.0)
    client.fly(2.9)
    assert client.velocity[0] == pytest.approx(2.0, abs=0.1)
    client.fly(1.9)
    assert client.velocity[0] < 0.15
    assert client.vehicle.mode == AP_GUIDED


def test_ardupilot_holds_a_single_position_setpoint_for_ever() -> None:
    client = airborne("ardupilot")
    client.setpoint(mask=POSITION, x=3.0, y=4.0, z=-5.0)
    client.fly(15.0)
    assert client.dynamics.position_ned_m[0] == pytest.approx([6.0, 2.0, -5.0], abs=0.1)


MOVING = {"vx": 1.0, "vy": 0.5}


@pytest.mark.parametrize(
    ("mask", "frame", "values", "velocity"),
    [
        (VELOCITY, 1, MOVING, (1.0, 0.5)),
        (VELOCITY_YAW, 1, MOVING, (1.0, 0.5)),
        (VELOCITY_YAW_RATE, 1, MOVING, (1.0, 0.5)),
        (VELOCITY | 0xF000, 1, MOVING, (1.0, 0.5)),
        (VELOCITY | 0x200, 1, MOVING, (1.0, 0.5)),  # force, acceleration ignored
        (VELOCITY | 0x020, 1, MOVING, (0.0, 0.0)),  # one bit ignores the group
        (VELOCITY | 0x008, 1, MOVING, (0.0, 0.0)),
        (0xFFF, 1, MOVING, (0.0, 0.0)),  # nothing used
        (0xC07 | 0x200, 1, MOVING, (0.0, 0.0)),  # force, acceleration used
        (0xC38, 1, MOVING, (0.0, 0.0)),  # position and acceleration without velocity
        (VELOCITY, 7, MOVING, (1.0, 0.5)),
        (VELOCITY, 0, MOVING, (0.0, 0.0)),
        (VELOCITY, 12, MOVING, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": 2000.0}, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": NAN, "vy": 1.0}, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": math.inf}, (0.0, 0.0)),
        (VELOCITY, 8, {"vx": 1.0}, (math.cos(0.5), math.sin(0.5))),
        (VELOCITY, 9, {"vy": 1.0}, (-math.sin(0.5), math.cos(0.5))),
    ],
)
def test_ardupilot_reads_the_type_mask_by_groups(
    mask: int, frame: int, values: dict[str, float], velocity: tuple[float, float]
) -> None:
    client = airborne("ardupilot")
    client.dynamics.yaw_rad[:] = 0.5
    client.tick()
    client.fly(3.0, vx=-1.0)
    client.fly(6.0, mask=mask | 0x400, frame=frame, **values)
    assert client.velocity[:2] == pytest.approx(velocity, abs=0.1)
    assert client.vehicle.mode == AP_GUIDED


@pytest.mark.parametrize(
    ("mask", "frame", "values", "velocity"),
    [
        (VELOCITY, 1, MOVING, (1.0, 0.5)),
        (VELOCITY_YAW_RATE, 1, MOVING, (1.0, 0.5)),
        (0xDE3, 1, {"vx": 1.0, "vy": 0.5, "z": -5.0}, (1.0, 0.5)),  # velocity xy, position z
        (VELOCITY | 0x200, 1, MOVING, (1.0, 0.5)),
        (VELOCITY | 0x030, 1, MOVING, (0.0, 0.0)),  # only vx
        (VELOCITY | 0x020, 1, MOVING, (0.0, 0.0)),  # nothing vertical
        (0xDFC, 1, {"x": 9.0}, (0.0, 0.0)),  # only x and y
        (VELOCITY, 1, {"vx": NAN, "vy": 1.0}, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": math.inf}, (0.0, 0.0)),
        (VELOCITY, 8, {"vx": 1.0}, (math.cos(0.5), math.sin(0.5))),
    ],
)
def test_px4_flies_whole_setpoints_and_stops_on_half_ones(
    mask: int, frame: int, values: dict[str, float], velocity: tuple[float, float]
) -> None:
    client = airborne("px4")
    client.dynamics.yaw_rad[:] = 0.5
    client.fly(2.0, vx=-1.0)
    client.fly(10.0, mask=mask, frame=frame, **values)
    if frame == 8 or not mask & 0x800:
        yaw = client.dynamics.yaw_rad[0]
        velocity = velocity if mask & 0x800 == 0 else (math.cos(yaw), math.sin(yaw))
    assert client.velocity[:2] == pytest.approx(velocity, abs=0.1)
    assert client.vehicle.mode == PX4_OFFBOARD


@pytest.mark.parametrize(
    ("mask", "frame", "target", "values", "text"),
    [
        (0xDFF, 1, (7, 1), {}, "SET_POSITION_TARGET_LOCAL_NED invalid"),
        (0x9FF, 1, (7, 1), {"yaw": 1.0}, "SET_POSITION_TARGET_LOCAL_NED invalid"),
        (VELOCITY, 1, (7, 1), {"vx": NAN, "vy": NAN, "vz": NAN}, "invalid"),
        (0xC3F | 0x200, 1, (7, 1), {"afx": 1.0}, "force not supported"),
        (POSITION, 8, (7, 1), {"x": 1.0}, "invalid"),
        (VELOCITY, 5, (7, 1), MOVING, "coordinate frame 5 unsupported"),
        (VELOCITY, 7, (7, 1), MOVING, "coordinate frame 7 unsupported"),
        (VELOCITY, 9, (7, 1), MOVING, "coordinate frame 9 unsupported"),
        (VELOCITY, 12, (7, 1), MOVING, "coordinate frame 12 unsupported"),
        (VELOCITY, 1, (8, 1), MOVING, None),
        (VELOCITY, 1, (7, 50), MOVING, None),
    ],
)
def test_px4_does_not_count_what_is_no_setpoint(
    mask: int, frame: int, target: tuple[int, int], values: dict[str, float], text: str | None
) -> None:
    client = airborne("px4")
    client.gcs_heartbeat()
    accepted = len(client.vehicle.setpoint_times)
    client.fly(1.0, mask=mask, frame=frame, target=target, **values)
    complaints = "".join(client.texts)
    assert text in complaints if text else "SET_POSITION" not in complaints
    client.fly(0.5, mask=mask, frame=frame, target=target, **values)
    assert client.vehicle.mode == PX4_POSCTL
    assert len(client.vehicle.setpoint_times) == accepted


@both
def test_a_broadcast_setpoint_is_obeyed(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(4.0, target=(0, 0), vx=1.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


def test_ardupilot_obeys_setpoints_for_other_components_but_not_for_other_systems() -> None:
    client = airborne("ardupilot")
    client.fly(4.0, target=(7, 50), vx=1.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.1)
    client.fly(6.0, target=(8, 1), vx=1.0)
    assert client.velocity[0] == pytest.approx(0.0, abs=0.1)


@both
def test_position_with_velocity_feeds_forward(personality: Personality) -> None:
    client = airborne(personality)
    start = client.dynamics.position_ned_m[0].copy() - np.array([3.0, -2.0, 0.0])
    for step in range(60):
        client.setpoint(mask=0xDC0, x=start[0] + 0.1 * step, y=start[1], z=-5.0, vx=1.0)
        client.tick()
    lag = start[0] + 0.1 * 60 - (client.dynamics.position_ned_m[0, 0] - 3.0)
    assert abs(lag) < 0.6
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


@both
def test_acceleration_alone_is_flown(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(2.0, mask=0xC3F, afx=1.0)
    assert client.velocity[0] > 0.8
    assert client.height_m == pytest.approx(5.0, abs=0.5)


def test_an_ardupilot_offset_runs_away_when_it_is_repeated() -> None:
    client = airborne("ardupilot")
    north = client.dynamics.position_ned_m[0, 0]
    client.fly(5.0, mask=POSITION, frame=7, x=2.0)
    assert client.dynamics.position_ned_m[0, 0] > north + 3.5


@both
def test_yaw_and_yaw_rate_are_followed(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(5.0, mask=VELOCITY_YAW, yaw=-1.0)
    assert client.dynamics.yaw_rad[0] == pytest.approx(-1.0, abs=0.05)
    client.fly(2.0, mask=VELOCITY_YAW_RATE, yaw_rate=0.5)
    assert client.dynamics.yaw_rate_rad_s[0] == pytest.approx(0.5, abs=0.02)


@both
def test_setpoint_times_are_arrivals(personality: Personality) -> None:
    client = airborne(personality)
    del client.vehicle.setpoint_times[:]
    client.fly(1.0, vx=0.0)
    assert np.diff(client.vehicle.setpoint_times) == pytest.approx([0.1] * 9)


def test_only_the_latest_setpoint_times_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "SETPOINTS_KEPT", 5)
    client = airborne("px4")
    client.fly(1.0, vx=0.0)
    times = client.vehicle.setpoint_times
    assert len(times) == 5
    assert times[-1] == pytest.approx(client.now, abs=0.2)
    assert np.diff(times) == pytest.approx([0.1] * 4)


@both
def test_landing_by_a_setpoint_is_noticed(personality: Personality) -> None:
    client = airborne(personality, 2.0)
    took_s = client.fly_until(lambda: not client.vehicle.armed, vz=0.5)
    assert client.height_m == 0.0
    assert took_s < (12.0 if personality == "px4" else 20.0)


@pytest.mark.parametrize("broken", [None, "vx", "yaw"])
def test_the_usual_setpoint_is_understood_as_any_other(
    monkeypatch: pytest.MonkeyPatch, broken: str | None
) -> None:
    message = wire.message("SET_POSITION_TARGET_LOCAL_NED")
    axes = dict.fromkeys(("x", "y", "z", "afx", "afy", "afz", "yaw_rate"), 0.0)
    given = axes | {"vx": 1.0, "vy": -2.0, "vz": 0.5, "yaw": 0.25}
    given |= {broken: math.inf} if broken else {}
    about = {"time_boot_ms": 1, "target_system": 1, "target_component": 1, "coordinate_frame": 1}
    values = message.values(**about, **given, type_mask=px4_setpoints.VELOCITY_AND_YAW)
    short = px4_setpoints.read(values, 0.0)
    monkeypatch.setattr(px4_setpoints, "VELOCITY_AND_YAW", -1)
    assert repr(short) == repr(px4_setpoints.read(values, 0.0))  # NaN is not equal to NaN
    assert (short is STOP) == (broken == "vx")
