from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from mock_client import (
    ACCEPTED,
    AP_GUIDED,
    AP_LAND,
    AP_RTL,
    FAILED,
    POSITION,
    PX4_LAND,
    PX4_LOITER,
    PX4_OFFBOARD,
    PX4_POSCTL,
    PX4_RTL,
    REJECTED,
    Client,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.vehicle import Personality

PX4_TERMINATION = 10 << 16
CRITICAL, TERMINATED = 5, 8
STATION = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


class Flight(Client):
    """A flight with, or without, a ground station that sends heartbeats."""

    def __init__(self, personality: Personality, **options: Any) -> None:
        super().__init__(personality, **options)
        self.station_sysid: int | None = None
        self.before_tick = self.hear_station

    def hear_station(self) -> None:
        if self.station_sysid is not None and self.ticks % 10 == 0:
            STATION.srcSystem = self.station_sysid
            heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
            self.vehicle.receive(heartbeat.pack(STATION), self.now)

    def modes(self, seconds: float, **setpoint: Any) -> list[tuple[Any, int]]:
        """Fly on, and note when the mode changes to what."""
        begin, mode, changes = self.now, self.vehicle.mode, []
        while self.now - begin < seconds:
            self.fly(0.1, **setpoint)
            if self.vehicle.mode != mode:
                mode = self.vehicle.mode
                changes.append((self.now - begin, mode))
        return changes

    @property
    def status(self) -> int:
        """HEARTBEAT.system_status of now."""
        return int(self.vehicle.autopilot.system_status(self.now))


def flight(personality: Personality, *, station: int | None = None, **parameters: float) -> Flight:
    """Give a vehicle at 5 m that follows setpoints."""
    it = Flight(personality, parameters=parameters)
    it.station_sysid = station
    it.take_off()
    it.go_offboard()
    it.fly(2.0, vx=1.0)
    return it


# PX4 without setpoints.


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, PX4_POSCTL), (3, PX4_RTL), (4, PX4_LAND), (5, PX4_LOITER), (6, PX4_TERMINATION)],
)
def test_px4_without_setpoints_does_what_com_obl_rc_act_says(action: int, mode: int) -> None:
    px4 = flight("px4", station=255, COM_OBL_RC_ACT=action)
    assert px4.modes(1.3) == [(pytest.approx(1.0, abs=0.11), mode)]
    assert px4.status == (TERMINATED if action == 6 else CRITICAL)
    assert px4.texts[-1] == "Failsafe activated\t"


@pytest.mark.parametrize("delay_s", [0.0, 5.0])
def test_lost_setpoints_are_not_waited_for(delay_s: float) -> None:
    px4 = flight("px4", COM_OBL_RC_ACT=4, COM_FAIL_ACT_T=delay_s)
    assert px4.modes(2.0) == [(pytest.approx(1.0, abs=0.11), PX4_LAND)]


@pytest.mark.parametrize("action", [0, 4, 5])
def test_px4_returns_to_offboard_by_itself_when_setpoints_come_back(action: int) -> None:
    px4 = flight("px4", COM_OBL_RC_ACT=action)
    px4.fly(2.0)
    assert px4.modes(0.1, vx=1.0) == [(pytest.approx(0.1), PX4_OFFBOARD)]
    assert px4.status != CRITICAL
    px4.fly(0.8)
    assert px4.velocity[0] > 0.3
    px4.fly(5.0, vx=1.0)
    assert px4.velocity[0] == pytest.approx(1.0, abs=0.15)


def test_a_mode_that_the_user_chooses_ends_the_failsafe_for_good() -> None:
    px4 = flight("px4", COM_OBL_RC_ACT=4)
    px4.fly(2.0)
    px4.set_mode(PX4_LOITER)
    assert px4.modes(2.0, vx=1.0) == []
    assert px4.vehicle.mode == PX4_LOITER
    assert px4.status != CRITICAL


def test_px4_lands_by_a_failsafe_disarms_and_reads_offboard_again() -> None:
    px4 = flight("px4", COM_OBL_RC_ACT=4)
    took_s = px4.fly_until(lambda: not px4.vehicle.armed)
    assert took_s == pytest.approx(12.6, abs=2.0)
    assert px4.vehicle.mode == PX4_OFFBOARD
    assert px4.status == 0


def test_px4_is_terminated_for_ever() -> None:
    px4 = flight("px4", COM_OBL_RC_ACT=6)
    px4.fly(1.2)
    assert px4.set_mode(PX4_LOITER) == [(176, ACCEPTED), (176, REJECTED)]
    px4.command(21)
    assert px4.vehicle.mode == PX4_TERMINATION
    px4.fly(1.0, vx=0.0)
    assert px4.height_m < 1.0
    px4.fly(5.0)
    assert not px4.vehicle.armed


def test_px4_disarms_in_the_air_when_it_is_told_so() -> None:
    px4 = flight("px4", COM_OBL_RC_ACT=7)
    assert px4.fly_until(lambda: not px4.vehicle.armed) == pytest.approx(1.0, abs=0.11)
    assert px4.height_m > 4.0
    px4.fly(3.0)
    assert px4.height_m == 0.0


# PX4 without its ground station.


@pytest.mark.parametrize(
    ("action", "changes"),
    [
        (0, []),
        (1, [(12.2, PX4_LOITER)]),
        (2, [(12.2, PX4_LOITER), (17.2, PX4_RTL)]),
        (3, [(12.2, PX4_LOITER), (17.2, PX4_LAND)]),
    ],
)
def test_px4_without_a_ground_station_holds_before_it_acts(
    action: int, changes: list[tuple[float, int]]
) -> None:
    px4 = flight("px4", station=255, NAV_DLL_ACT=action)
    px4.fly_until(lambda: px4.ticks % 10 == 0, vx=0.0)
    px4.station_sysid = None
    seen = px4.modes(20.0, vx=0.0)
    assert [mode for _, mode in seen] == [mode for _, mode in changes]
    assert [at for at, _ in seen] == pytest.approx([at for at, _ in changes], abs=0.3)
    assert px4.status == (CRITICAL if changes else 4)


def test_px4_goes_on_when_the_ground_station_is_heard_again() -> None:
    px4 = flight("px4", station=255, NAV_DLL_ACT=2)
    px4.station_sysid = None
    px4.fly_until(lambda: px4.vehicle.mode == PX4_LOITER, vx=1.0)
    px4.station_sysid = 255
    assert px4.modes(1.2, vx=1.0)[-1][1] == PX4_OFFBOARD


def test_a_loss_that_the_user_flew_on_from_counts_again_the_next_time() -> None:
    px4 = flight("px4", station=255, NAV_DLL_ACT=1)
    for _ in range(2):
        px4.station_sysid = None
        px4.fly_until(lambda: px4.status == CRITICAL, vx=0.0)
        px4.set_mode(PX4_LOITER)
        assert px4.status != CRITICAL
        px4.fly(5.0, vx=0.0)
        assert px4.status != CRITICAL
        px4.station_sysid = 255
        px4.fly(2.0, vx=0.0)


def test_the_delays_of_a_lost_ground_station_are_parameters() -> None:
    px4 = flight("px4", station=255, NAV_DLL_ACT=3, COM_DL_LOSS_T=5, COM_FAIL_ACT_T=2.0)
    px4.fly_until(lambda: px4.ticks % 10 == 0, vx=0.0)
    px4.station_sysid = None
    times = [at for at, _ in px4.modes(12.0, vx=0.0)]
    assert times == pytest.approx([7.2, 9.2], abs=0.3)


def test_px4_arms_only_with_a_ground_station_where_it_needs_one() -> None:
    px4 = Flight("px4", parameters={"NAV_DLL_ACT": 2})
    px4.fly(2.0)
    assert px4.command(400, 1) == [(400, REJECTED)]
    px4.station_sysid = 255
    px4.fly(1.0)
    assert px4.command(400, 1) == [(400, ACCEPTED)]


# PX4 with an empty battery.


def test_px4_returns_on_a_critical_battery_and_lands_in_an_emergency() -> None:
    px4 = flight("px4", station=255)
    px4.fly(2.0, mask=POSITION, x=14.0, z=-5.0)
    px4.readings.battery_fraction[:] = 0.14
    assert px4.modes(2.0, vx=0.0) == []
    assert px4.texts[-1] == "Low battery level\t"
    px4.readings.battery_fraction[:] = 0.06
    changes = px4.modes(6.0, vx=0.0)
    assert [mode for _, mode in changes] == [PX4_LOITER, PX4_RTL]
    assert [at for at, _ in changes] == pytest.approx([0.1, 5.1], abs=0.15)
    px4.readings.battery_fraction[:] = 0.04
    assert [mode for _, mode in px4.modes(6.0, vx=0.0)] == [PX4_LAND]
    assert "Critical battery level\t" in px4.texts
    assert "Emergency battery level\t" in px4.texts
    px4.fly_until(lambda: not px4.vehicle.armed, vx=0.0)


@pytest.mark.parametrize(("action", "modes"), [(0, []), (2, [PX4_LOITER, PX4_LAND])])
def test_what_an_empty_battery_does_is_com_low_bat_act(action: int, modes: list[int]) -> None:
    px4 = flight("px4", COM_LOW_BAT_ACT=action)
    px4.readings.battery_fraction[:] = 0.06
    assert [mode for _, mode in px4.modes(7.0, vx=0.0)] == modes


def test_a_landing_that_the_user_chose_is_left_alone_by_an_empty_battery() -> None:
    px4 = flight("px4")
    px4.command(21)
    px4.readings.battery_fraction[:] = 0.06
    assert px4.modes(3.0) == []


def test_the_user_may_fly_on_with_a_critical_battery_until_the_emergency() -> None:
    px4 = flight("px4")
    px4.readings.battery_fraction[:] = 0.06
    px4.fly(7.0)
    px4.set_mode(PX4_LOITER)
    assert px4.modes(10.0) == []
    px4.readings.battery_fraction[:] = 0.04
    assert [mode for _, mode in px4.modes(7.0)] == [PX4_LAND]


# ArduPilot without its ground station.


@pytest.mark.parametrize(("action", "mode"), [(0, None), (1, AP_RTL), (5, AP_LAND)])
def test_ardupilot_without_a_ground_station_does_what_fs_gcs_enable_says(
    action: int, mode: int | None
) -> None:
    ap = flight("ardupilot", station=255, FS_GCS_ENABLE=action)
    ap.fly_until(lambda: ap.ticks % 10 == 0, vx=1.0)
    ap.station_sysid = None
    changes = ap.modes(8.0, vx=1.0)  # setpoints are no substitute
    assert changes == ([(pytest.approx(5.3, abs=0.15), mode)] if mode else [])
    assert ap.status == (CRITICAL if mode else 4)
    assert ("GCS Failsafe" in ap.texts) == bool(mode)


def test_a_ground_station_that_is_back_is_noted_and_the_mode_stays() -> None:
    ap = flight("ardupilot", station=255, FS_GCS_ENABLE=1)
    ap.station_sysid = None
    ap.fly(7.0)
    ap.station_sysid = 255
    assert ap.modes(1.5) == []
    assert ap.texts[-1] == "GCS Failsafe Cleared"
    assert ap.status == 4
    assert ap.set_mode(AP_GUIDED) == [(176, ACCEPTED)]
    assert ap.modes(3.0) == []


def test_the_timeout_of_the_ground_station_is_a_parameter() -> None:
    ap = flight("ardupilot", station=255, FS_GCS_ENABLE=5, FS_GCS_TIMEOUT=2)
    ap.fly_until(lambda: ap.ticks % 10 == 0)
    ap.station_sysid = None
    assert ap.modes(4.0) == [(pytest.approx(2.3, abs=0.15), AP_LAND)]


@pytest.mark.parametrize("parameters", [{}, {"MAV_GCS_SYSID": 200}])
def test_only_the_ground_station_of_mav_gcs_sysid_counts(parameters: Mapping[str, float]) -> None:
    ap = flight("ardupilot", station=200, FS_GCS_ENABLE=1, **parameters)
    assert ap.modes(8.0, vx=0.0) == []
    ap.station_sysid = 255 if parameters else None
    assert bool(ap.modes(8.0, vx=0.0)) == bool(parameters)


def test_ardupilot_disarms_on_the_ground_when_its_ground_station_is_lost() -> None:
    ap = Flight("ardupilot", parameters={"FS_GCS_ENABLE": 1, "DISARM_DELAY": 60})
    ap.station_sysid = 255
    ap.fly(2.0)
    ap.set_mode(AP_GUIDED)
    ap.command(400, 1)
    ap.station_sysid = None
    assert ap.fly_until(lambda: not ap.vehicle.armed) == pytest.approx(5.3, abs=1.1)
    assert ap.vehicle.mode == AP_GUIDED


# ArduPilot with an empty battery.

CELLS = 4 / 3
"""The mock's battery has four, and ArduPilot's simulator speaks of three."""


@pytest.mark.parametrize(("action", "mode"), [(0, None), (1, AP_LAND), (2, AP_RTL)])
def test_a_low_voltage_of_ten_seconds_is_a_battery_failsafe(action: int, mode: int | None) -> None:
    ap = flight("ardupilot", BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=action)
    ap.readings.battery_voltage_v[:] = 11.0 * CELLS
    ap.readings.battery_fraction[:] = 1.0 - 180 / 3300
    changes = ap.modes(11.0, vx=0.0)
    assert changes == ([(pytest.approx(10.1, abs=0.15), mode)] if mode else [])
    assert ap.texts.count("Battery Failsafe") == 1
    assert ap.texts[-2:] == ["Battery 1 is low 11.00V used 180 mAh", "Battery Failsafe"]
    assert ap.status == CRITICAL


def test_the_simulator_is_told_of_a_low_battery_by_a_parameter() -> None:
    ap = flight("ardupilot", BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=1)
    ap.vehicle.autopilot.set_parameter("SIM_BATT_VOLTAGE", 11.0)
    assert [mode for _, mode in ap.modes(11.0, vx=0.0)] == [AP_LAND]


def test_a_landing_by_failsafe_pauses_before_it_descends() -> None:
    ap = flight("ardupilot", BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=1)
    ap.readings.battery_voltage_v[:] = 11.0 * CELLS
    ap.fly_until(lambda: ap.vehicle.mode == AP_LAND, vx=0.0)
    ap.fly(3.8)
    assert ap.height_m == pytest.approx(5.0, abs=0.2)
    ap.fly(4.0)
    assert ap.height_m == pytest.approx(3.3, abs=0.4)


def test_a_dip_of_the_voltage_is_not_a_low_battery() -> None:
    ap = flight("ardupilot", BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=1)
    for _ in range(4):
        ap.readings.battery_voltage_v[:] = 11.0 * CELLS
        assert ap.modes(9.0, vx=0.0) == []
        ap.readings.battery_voltage_v[:] = 12.0 * CELLS
        ap.fly(0.5, vx=0.0)


def test_a_critical_battery_acts_after_a_low_one_has() -> None:
    ap = flight(
        "ardupilot", BATT_LOW_MAH=1000, BATT_FS_LOW_ACT=2, BATT_CRT_MAH=500, BATT_FS_CRT_ACT=1
    )
    ap.readings.battery_fraction[:] = 0.25
    assert [mode for _, mode in ap.modes(1.0)] == [AP_RTL]
    ap.readings.battery_fraction[:] = 0.1
    assert [mode for _, mode in ap.modes(1.0)] == [AP_LAND]


# Arming.


def test_ardupilot_arms_a_pilots_mode_before_it_is_ready_without_arming_checks() -> None:
    ap = Flight("ardupilot", boot_s=30.0)
    ap.fly(10.0)
    assert ap.command(400, 1) == [(400, FAILED)]
    ap.vehicle.autopilot.set_parameter("ARMING_CHECK", 0)
    ap.set_mode(AP_GUIDED)
    assert ap.command(400, 1) == [(400, FAILED)]
    ap.set_mode(0)
    assert ap.command(400, 1) == [(400, ACCEPTED)]


def test_the_default_failsafes_of_ardupilot_do_nothing() -> None:
    ap = flight("ardupilot", station=255)
    ap.station_sysid = None
    ap.readings.battery_voltage_v[:] = 10.6 * CELLS
    ap.readings.battery_fraction[:] = 0.01
    assert ap.modes(20.0, vx=0.0) == []
