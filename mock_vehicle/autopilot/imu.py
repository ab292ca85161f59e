"""What the inertial sensors, the compass and the barometer feel, and what is really so."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.clock import boot_ms, boot_us
from mock_vehicle.autopilot.gnss import e7, millimetres
from mock_vehicle.autopilot.link import Encoder
from mock_vehicle.autopilot.manoeuvres import Vector
from mock_vehicle.autopilot.streams import clamped, quaternion
from mock_vehicle.dynamics import GRAVITY_M_S2
from mock_vehicle.geodesy import Origin
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

HIGHRES_IMU = wire.message("HIGHRES_IMU")
HIL_STATE_QUATERNION = wire.message("HIL_STATE_QUATERNION")
RAW_IMU = wire.message("RAW_IMU")
SCALED_IMU2 = wire.message("SCALED_IMU2")
SCALED_IMU3 = wire.message("SCALED_IMU3")
SCALED_PRESSURE = wire.message("SCALED_PRESSURE")
SCALED_PRESSURE2 = wire.message("SCALED_PRESSURE2")
SIMSTATE = wire.message("SIMSTATE")
SIM_STATE = wire.message("SIM_STATE")
VIBRATION = wire.message("VIBRATION")

FIELD_NED_GAUSS: Vector = (0.2175, 0.0121, 0.4296)
"""The earth's magnetic field at the recorded place."""
ALL_UPDATED = 63
TEMPERATURE_C = 15.0
SEA_LEVEL_HPA = 1013.25
FLYING_VIBRATION_M_S2 = (0.0, 0.1, 1.44)
PARKED_VIBRATION_M_S2 = (0.0, 0.011, 0.11)
INT16 = (-0x8000, 0x7FFF)


def in_body(autopilot: Autopilot, vector_ned: Vector) -> Vector:
    """Turn a vector from NED into body FRD."""
    s = autopilot.state
    north, east, down = vector_ned
    cy, sy = math.cos(s.yaw_rad), math.sin(s.yaw_rad)
    cp, sp = math.cos(s.pitch_rad), math.sin(s.pitch_rad)
    cr, sr = math.cos(s.roll_rad), math.sin(s.roll_rad)
    ahead, right = cy * north + sy * east, cy * east - sy * north
    x, below = cp * ahead - sp * down, sp * ahead + cp * down
    return x, cr * right + sr * below, cr * below - sr * right


def specific_force(autopilot: Autopilot) -> Vector:
    """Give what an accelerometer feels, m/s2 in body FRD: at rest one g upwards."""
    north, east, down = autopilot.truth.acceleration_ned_m_s2[autopilot.index].tolist()
    return in_body(autopilot, (north, east, down - GRAVITY_M_S2))


def pressure_hpa(amsl_m: float) -> float:
    """Give the pressure of the standard atmosphere at an altitude."""
    relative: float = max(1.0 - 2.25577e-5 * amsl_m, 0.0) ** 5.25588
    return SEA_LEVEL_HPA * relative


def true_place(autopilot: Autopilot) -> Origin:
    """Give where the vehicle really is."""
    return autopilot.navigation.site.to_global(*autopilot.state.true_position_m)


def highres_imu(autopilot: Autopilot, now: float) -> None:
    """Send HIGHRES_IMU."""
    altitude_m = true_place(autopilot).amsl_m
    autopilot.send(
        HIGHRES_IMU,
        boot_us(autopilot, now),
        *specific_force(autopilot),
        0.0,
        0.0,
        autopilot.state.yaw_rate_rad_s,
        *in_body(autopilot, FIELD_NED_GAUSS),
        pressure_hpa(altitude_m),
        0.0,
        altitude_m,
        TEMPERATURE_C,
        ALL_UPDATED,
        0,
    )


def _milli(autopilot: Autopilot) -> list[int]:
    """Give accelerations in milli-g, turn rates in mrad/s and the field in milligauss."""
    force = (component / GRAVITY_M_S2 for component in specific_force(autopilot))
    field = in_body(autopilot, FIELD_NED_GAUSS)
    felt = (*force, 0.0, 0.0, autopilot.state.yaw_rate_rad_s, *field)
    return [clamped(component * 1e3, *INT16) for component in felt]


def raw_imu(autopilot: Autopilot, now: float) -> None:
    """Send RAW_IMU."""
    autopilot.send(RAW_IMU, boot_us(autopilot, now), *_milli(autopilot), 0, 3000)


def scaled_imu2(autopilot: Autopilot, now: float) -> None:
    """Send SCALED_IMU2."""
    autopilot.send(SCALED_IMU2, boot_ms(autopilot, now), *_milli(autopilot), 3000)


def scaled_imu3(autopilot: Autopilot, now: float) -> None:
    """Send SCALED_IMU3, which has a compass alone."""
    field = _milli(autopilot)[6:]
    autopilot.send(SCALED_IMU3, boot_ms(autopilot, now), *(0,) * 6, *field, 0)


def scaled_pressure(autopilot: Autopilot, now: float) -> None:
    """Send SCALED_PRESSURE."""
    pressure = pressure_hpa(true_place(autopilot).amsl_m)
    autopilot.send(SCALED_PRESSURE, boot_ms(autopilot, now), pressure, 0.0, 1180, 0)


def scaled_pressure2(autopilot: Autopilot, now: float) -> None:
    """Send SCALED_PRESSURE2."""
    pressure = pressure_hpa(true_place(autopilot).amsl_m)
    autopilot.send(SCALED_PRESSURE2, boot_ms(autopilot, now), pressure, 0.0, 1180, 0)


def vibration(autopilot: Autopilot, now: float) -> None:
    """Send VIBRATION: more of it in the air."""
    shaking = FLYING_VIBRATION_M_S2 if autopilot.flying else PARKED_VIBRATION_M_S2
    autopilot.send(VIBRATION, boot_us(autopilot, now), *shaking, 0, 0, 0)


# The truth, which only simulators know.


def hil_state_quaternion(autopilot: Autopilot, now: float) -> None:
    """Send HIL_STATE_QUATERNION, as viewers want it."""
    s, place = autopilot.state, true_place(autopilot)
    velocity = (s.north_m_s, s.east_m_s, s.down_m_s)
    autopilot.send(
        HIL_STATE_QUATERNION,
        boot_us(autopilot, now),
        quaternion(s),
        0.0,
        0.0,
        s.yaw_rate_rad_s,
        e7(place.latitude_deg),
        e7(place.longitude_deg),
        millimetres(place.amsl_m),
        *(clamped(component * 100.0, *INT16) for component in velocity),
        0,
        0,
        *_milli(autopilot)[:3],
    )


def simstate(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send SIMSTATE."""
    s, place = autopilot.state, true_place(autopilot)
    autopilot.send(
        SIMSTATE,
        s.roll_rad,
        s.pitch_rad,
        s.yaw_rad,
        *specific_force(autopilot),
        0.0,
        0.0,
        s.yaw_rate_rad_s,
        e7(place.latitude_deg),
        e7(place.longitude_deg),
    )


def sim_state(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send SIM_STATE."""
    s, place = autopilot.state, true_place(autopilot)
    latitude, longitude = e7(place.latitude_deg), e7(place.longitude_deg)
    autopilot.send(
        SIM_STATE,
        *quaternion(s),
        s.roll_rad,
        s.pitch_rad,
        s.yaw_rad,
        *specific_force(autopilot),
        0.0,
        0.0,
        s.yaw_rate_rad_s,
        float(latitude),
        float(longitude),
        place.amsl_m,
        0.0,
        0.0,
        s.north_m_s,
        s.east_m_s,
        s.down_m_s,
        latitude,
        longitude,
    )


STREAMS: Mapping[int, Encoder] = {
    HIGHRES_IMU.id: highres_imu,
    SCALED_PRESSURE.id: scaled_pressure,
    VIBRATION.id: vibration,
}
"""What both autopilots send, by message id."""

PX4_STREAMS: Mapping[int, Encoder] = {HIL_STATE_QUATERNION.id: hil_state_quaternion}
ARDUPILOT_STREAMS: Mapping[int, Encoder] = {
    RAW_IMU.id: raw_imu,
    SCALED_IMU2.id: scaled_imu2,
    SCALED_IMU3.id: scaled_imu3,
    SCALED_PRESSURE2.id: scaled_pressure2,
    SIMSTATE.id: simstate,
    SIM_STATE.id: sim_state,
}
