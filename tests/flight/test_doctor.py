"""Mock vehicles are examined before they fly, in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from messages import TABLES, random_values
from surgery import Surgery, hall_mission

from swarm_ctl import wire
from swarm_ctl.doctor import report
from swarm_ctl.doctor.diagnosis import Finding, case_of, diagnose
from swarm_ctl.doctor.examination import Examination, Question
from swarm_ctl.doctor.patient import TABLES as PARAMETERS
from swarm_ctl.doctor.rows import Severity
from swarm_ctl.signing import key_of

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
ARM = 400
LOW_RETURN: dict[str, dict[str, float]] = {
    "px4": {"RTL_RETURN_ALT": 1.5, "RTL_DESCEND_ALT": 1.5},
    "ardupilot": {"RTL_ALT": 150},
}
"""What lets a vehicle return below the ceiling of the hall."""
URL = "udpin://0.0.0.0:14540"


@pytest.fixture
def surgery() -> Iterator[Surgery]:
    with Surgery() as surgery:
        yield surgery


def named(findings: list[Finding]) -> dict[str, Finding]:
    """Give findings by what they are about."""
    return {finding.check: finding for finding in findings}


def errors(findings: list[Finding]) -> list[str]:
    return [finding.check for finding in findings if finding.severity is Severity.ERROR]


# -- who is fit ----------------------------------------------------------------------------------


@BOTH
def test_nothing_is_found_of_a_healthy_vehicle(surgery: Surgery, autopilot: str) -> None:
    surgery.admit(autopilot)
    examination = surgery.go_on(surgery.begin())
    assert surgery.findings(examination) == []
    assert surgery.now < 8.0
    known = report.facts(examination.patients[0])
    assert (known["autopilot"], known["kind"]) == (autopilot, "quadrotor")
    assert known["firmware"] == {"px4": "1.17.0 alpha", "ardupilot": "4.7.0 dev"}[autopilot]
    assert known["uids"] == ["0" * 32 + "0101"]
    assert set(known["rangefinders"]) == {"front", "back", "left", "right", "up", "down"}
    assert known["rangefinders"]["front"] == {"hz": pytest.approx(10.0, rel=0.1), "max_m": 8.0}
    assert known["round_trip_median_ms"] == pytest.approx(10.0, abs=11.0)
    assert known["messages_lost"] == 0
    assert 2_000 < known["link_bytes_per_s"] < 40_000
    assert "Fit to fly: 1 vehicle, no warnings." in report.verdict(
        examination, diagnose(examination)
    )


@pytest.mark.parametrize(
    ("autopilot", "parameters"),
    [("px4", {"COM_OF_LOSS_T": 9}), ("ardupilot", {"GUID_TIMEOUT": 3, "ARMING_CHECK": 0})],
)
def test_it_changes_nothing_that_it_was_not_told_to_change(
    surgery: Surgery, autopilot: str, parameters: dict[str, float]
) -> None:
    vehicle = surgery.admit(autopilot, parameters=parameters)
    surgery.pass_time(2.0)
    before = vehicle.parameters
    assert surgery.examine() != []
    assert vehicle.parameters == before
    assert vehicle.received("PARAM_SET") == []


@BOTH
def test_an_armed_vehicle_is_not_spoken_to(surgery: Surgery, autopilot: str) -> None:
    vehicle = surgery.admit(autopilot)
    surgery.command(vehicle, ARM, 1.0)
    surgery.pass_time(1.5)
    heard = len(vehicle.received())
    examination = surgery.go_on(surgery.begin())
    assert "armed" in errors(surgery.findings(examination))
    assert len(vehicle.received()) == heard


# -- parameters ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("autopilot", "parameters", "found", "advised"),
    [
        ("px4", {"COM_OF_LOSS_T": 5.0}, "5 s", "1 s"),
        ("px4", {"COM_OF_LOSS_T": 0.1}, "0.1 s", "0.5 s"),
        ("px4", {"COM_OBL_RC_ACT": 7}, "7 (disarm)", "4 (land)"),
        ("px4", {"NAV_DLL_ACT": 2}, "2 (return)", "0 (nothing)"),
        ("px4", {"NAV_RCL_ACT": 6}, "6 (disarm)", "1 (hold)"),
        ("px4", {"GF_ACTION": 4}, "4 (terminate)", "2 (hold)"),
        ("px4", {"GF_MAX_HOR_DIST": 20.0}, "20 m", "55 m"),
        ("px4", {"GF_MAX_VER_DIST": 3.0}, "3 m", "5.5 m"),
        ("px4", {"RTL_RETURN_ALT": 30.0}, "30 m", "1.5 m"),
        (
            "px4",
            {"EKF2_HGT_REF": 1, "EKF2_GPS_CTRL": 0},
            "1 (GPS)",
            "0 (barometer), and restart it",
        ),
        (
            "px4",
            {"EKF2_EV_CTRL": 0, "EKF2_OF_CTRL": 0, "SYS_HAS_GPS": 0},
            "0",
            "not 0, or EKF2_OF_CTRL not 0",
        ),
        ("px4", {"COM_ARM_WO_GPS": 0, "SYS_HAS_GPS": 0}, "0", "1"),
        ("ardupilot", {"GUID_TIMEOUT": 3.0}, "3 s", "1 s"),
        ("ardupilot", {"GUID_OPTIONS": 33}, "33", "1"),
        ("ardupilot", {"FENCE_RADIUS": 40, "FENCE_ENABLE": 1}, "40 m", "55 m"),
        ("ardupilot", {"FENCE_ALT_MAX": 5, "FENCE_ENABLE": 1}, "5 m", "5.5 m"),
        ("ardupilot", {"RTL_ALT": 1500}, "15 m", "1.5 m"),
        ("ardupilot", {"AVOID_MARGIN": 2, "PRX1_TYPE": 2}, "2 m", "0.5 m"),
        ("ardupilot", {"FS_EKF_ACTION": 0}, "0 (report only)", "1 (land)"),
        ("ardupilot", {"FS_EKF_THRESH": 0}, "0", "0.6"),
        ("ardupilot", {"BATT_FS_LOW_ACT": 5}, "5 (terminate)", "1 (land)"),
        ("ardupilot", {"ARMING_CHECK": 0}, "0", "1"),
        ("ardupilot", {"EK3_SRC1_VELXY": 3, "EK3_SRC1_POSXY": 6}, "3 (GPS)", "5 (optical flow)"),
        ("ardupilot", {"VISO_TYPE": 0, "EK3_SRC1_VELXY": 6}, "0", "not 0, and restart it"),
        ("ardupilot", {"MAV2_OPTIONS": 6}, "6", "4, and restart it"),
    ],
)
def test_a_parameter_that_would_bite_is_an_error(
    surgery: Surgery,
    tmp_path: Path,
    autopilot: str,
    parameters: dict[str, float],
    found: str,
    advised: str,
) -> None:
    surgery.admit(autopilot, parameters=LOW_RETURN[autopilot] | parameters)
    findings = surgery.examine(mission=hall_mission(tmp_path))
    finding = named(findings)[next(iter(parameters))]
    assert finding.severity is Severity.ERROR
    assert (finding.found, finding.advised) == (found, advised)
    assert len(finding.why) > 20


@pytest.mark.parametrize(
    ("autopilot", "parameters"),
    [
        ("px4", {"COM_OBL_RC_ACT": 0}),
        ("px4", {"COM_LOW_BAT_ACT": 0}),
        ("px4", {"COM_RC_IN_MODE": 0}),
        ("px4", {"CBRK_SUPPLY_CHK": 894281}),
        ("px4", {"MPC_XY_VEL_MAX": 0.5}),
        ("px4", {"COM_DISARM_PRFLT": 2.0}),
        ("px4", {"COM_FLT_TIME_MAX": 600}),
        ("px4", {"CP_DIST": 2.0}),
        ("px4", {"CBRK_FLIGHTTERM": 0}),
        ("px4", {"CBRK_IO_SAFETY": 0}),
        ("ardupilot", {"FS_GCS_ENABLE": 1}),
        ("ardupilot", {"MAV_GCS_SYSID": 2}),
        ("ardupilot", {"FS_OPTIONS": 16}),
        ("ardupilot", {"BATT_FS_LOW_ACT": 0}),
        ("ardupilot", {"ARMING_CHECK": 64}),
        ("ardupilot", {"DISARM_DELAY": 0}),
        ("ardupilot", {"LAND_SPEED": 200}),
        ("ardupilot", {"BATT_LOW_VOLT": 0}),
    ],
)
def test_a_parameter_to_be_known_is_a_warning(
    surgery: Surgery, tmp_path: Path, autopilot: str, parameters: dict[str, float]
) -> None:
    surgery.admit(autopilot, parameters=LOW_RETURN[autopilot] | parameters)
    findings = surgery.examine(mission=hall_mission(tmp_path))
    assert [finding.check for finding in findings] == list(parameters)
    assert findings[0].severity is Severity.WARNING


def test_limits_are_held_against_a_mission_alone(surgery: Surgery) -> None:
    surgery.admit("px4", parameters={"GF_MAX_HOR_DIST": 1.0, "RTL_RETURN_ALT": 300.0})
    assert surgery.examine() == []


def test_a_parameter_that_is_no_number_bites(surgery: Surgery) -> None:
    vehicle = surgery.admit("px4")
    set_ = wire.message("PARAM_SET").pack(0, 255, 190, 1, 1, "COM_OF_LOSS_T", float("nan"), 9)
    vehicle.send(set_)
    finding = named(surgery.examine())["COM_OF_LOSS_T"]
    assert (finding.found, finding.advised) == ("nan s", "0.5 s")


@BOTH
def test_every_advice_is_good_by_its_own_row(
    surgery: Surgery, tmp_path: Path, autopilot: str
) -> None:
    surgery.admit(autopilot)
    examination = surgery.go_on(surgery.begin(mission=hall_mission(tmp_path)))
    case = case_of(examination.patients[0], examination)
    for row in PARAMETERS[autopilot]:
        for value in (-1.0, 0.0, 1.0, 7.0, 255.0, 1e6):
            advised = row.good.advised(value, case)
            assert advised is None or row.good.holds(advised, case), (row.name, value, advised)


# -- setting parameters --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("autopilot", "parameters", "changed"),
    [
        (
            "px4",
            {"COM_OF_LOSS_T": 5.0, "COM_OBL_RC_ACT": 0, "NAV_DLL_ACT": 2, "RTL_RETURN_ALT": 30},
            {"COM_OF_LOSS_T": (5.0, 1.0), "COM_OBL_RC_ACT": (0, 4), "RTL_RETURN_ALT": (30, 1.5)},
        ),
        (
            "ardupilot",
            {"GUID_TIMEOUT": 3.0, "FS_GCS_ENABLE": 1, "RTL_ALT": 1500, "MAV2_OPTIONS": 6},
            {"GUID_TIMEOUT": (3, 1), "RTL_ALT": (1500, 150), "MAV2_OPTIONS": (6, 4)},
        ),
    ],
)
def test_fixing_sets_what_is_safe_to_set_and_nothing_else(
    surgery: Surgery,
    tmp_path: Path,
    autopilot: str,
    parameters: dict[str, float],
    changed: dict[str, tuple[float, float]],
) -> None:
    vehicle = surgery.admit(autopilot, parameters=LOW_RETURN[autopilot] | parameters)
    surgery.pass_time(2.0)
    before = vehicle.parameters
    examination = surgery.go_on(surgery.begin(mission=hall_mission(tmp_path)))
    patient = surgery.operate(examination)
    assert patient.changed == changed
    after = vehicle.parameters
    assert {n: (before[n], after[n]) for n in before if before[n] != after[n]} == changed
    left = named(surgery.findings(examination))
    assert (
        left.keys()
        == {
            "px4": {"NAV_DLL_ACT", "ready to arm"},
            "ardupilot": {"FS_GCS_ENABLE", "MAV2_OPTIONS"},
        }[autopilot]
    )
    if autopilot == "ardupilot":
        assert left["MAV2_OPTIONS"][2:4] == ("4, set just now", "restart the vehicle")


def test_what_was_set_is_read_back(surgery: Surgery) -> None:
    vehicle = surgery.admit("px4", parameters={"COM_OF_LOSS_T": 5.0})
    surgery.operate(surgery.go_on(surgery.begin()))
    spoken = [m.name for m in vehicle.received() if "COM_OF_LOSS_T" in str(m.values)]
    assert spoken == ["PARAM_REQUEST_READ", "PARAM_SET", "PARAM_REQUEST_READ"]


def test_a_set_whose_answer_is_lost_is_sent_again(surgery: Surgery) -> None:
    vehicle = surgery.admit("ardupilot", parameters={"GUID_TIMEOUT": 5.0})
    examination = surgery.go_on(surgery.begin())
    vehicle.faults.strike("ack-lost", count=1, message="PARAM_VALUE")
    assert surgery.operate(examination).changed == {"GUID_TIMEOUT": (5.0, 1.0)}
    assert len(vehicle.received("PARAM_SET")) == 2


def test_what_a_vehicle_does_not_take_is_said(surgery: Surgery) -> None:
    vehicle = surgery.admit("px4", parameters={"COM_OF_LOSS_T": 5.0})
    examination = surgery.go_on(surgery.begin())
    vehicle.faults.strike("link-loss", direction="uplink")
    patient = surgery.operate(examination)
    assert (patient.changed, patient.refused) == ({}, {"COM_OF_LOSS_T": 1.0})
    assert errors(surgery.findings(examination)) == ["COM_OF_LOSS_T"]


def test_nothing_is_set_on_a_vehicle_that_was_armed_meanwhile(surgery: Surgery) -> None:
    vehicle = surgery.admit("px4", parameters={"COM_OF_LOSS_T": 5.0})
    examination = surgery.go_on(surgery.begin())
    surgery.command(vehicle, ARM, 1.0)
    surgery.listen(examination, 1.5)
    patient = surgery.operate(examination)
    assert (patient.changed, vehicle.parameters["COM_OF_LOSS_T"]) == ({}, 5.0)


# -- one sysid for several -----------------------------------------------------------------------


def test_two_vehicles_of_one_sysid_behind_one_radio_are_told_apart_by_their_uids(
    surgery: Surgery,
) -> None:
    surgery.admit(seed=1)
    surgery.admit(seed=2)
    surgery.share_line()
    found = named(surgery.examine())["one sysid, several vehicles"]
    assert "2 vehicles answer: uids" in found.found
    assert found.severity is Severity.ERROR


def test_two_vehicles_of_one_sysid_on_two_links_are_found(surgery: Surgery) -> None:
    surgery.admit(seed=1)
    surgery.admit(seed=2, url="udpin://0.0.0.0:14541")
    found = [f for f in surgery.examine() if f.check == "one sysid, several vehicles"]
    assert len(found) == 2
    assert "14540" in found[0].found
    assert "14541" in found[0].found


def test_one_vehicle_on_two_links_is_found(surgery: Surgery) -> None:
    surgery.admit()
    surgery.admit(url="udpin://0.0.0.0:14541")
    assert set(errors(surgery.examine())) == {"one vehicle, several links"}


def test_a_swarm_on_one_port_is_examined_one_by_one(surgery: Surgery) -> None:
    for sysid in (1, 2, 3):
        surgery.admit("ardupilot", sysid=sysid)
    examination = surgery.go_on(surgery.begin())
    assert [patient.chart.sysid for patient in examination.patients] == [1, 2, 3]
    assert surgery.findings(examination) == []


def test_only_who_is_asked_for_is_examined(surgery: Surgery) -> None:
    one, two = surgery.admit(sysid=1), surgery.admit(sysid=2)
    examination = surgery.go_on(surgery.begin(wanted=frozenset({(URL, 2)})))
    assert [patient.chart.sysid for patient in examination.patients] == [2]
    assert (one.received(), two.received() == []) == ([], False)


def test_a_sysid_that_no_peer_can_use_is_an_error(surgery: Surgery) -> None:
    surgery.admit(sysid=251)
    assert errors(surgery.examine()) == ["sysid"]


def test_who_is_not_heard_is_named(surgery: Surgery) -> None:
    surgery.admit()
    other = "udpin://0.0.0.0:9"
    wanted = frozenset({(URL, 1), (URL, 7), (other, 8)})
    examination = surgery.begin(urls=[URL, other], wanted=wanted, patience_s=6.0)
    surgery.go_on(examination)
    assert report.silences(examination) == [
        f"{other}: no autopilot is heard",
        f"{URL}: vehicle 7 is not heard",
    ]


def test_another_controller_of_the_same_vehicle_is_found(surgery: Surgery) -> None:
    surgery.admit()
    examination = surgery.begin()
    beat = wire.message("HEARTBEAT").pack(0, 1, 191, 18, 8, 0, 0, 4, 3)
    examination.receive(URL, ("10.0.0.1", 1), beat, 0.0)
    assert errors(surgery.findings(surgery.go_on(examination))) == ["another controller"]


# -- link and clock ------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.2, 2.0])
def test_a_clock_that_goes_differently_is_an_error(surgery: Surgery, rate: float) -> None:
    surgery.admit()
    surgery.clock_rate = rate
    found = named(surgery.examine())["clock"]
    faster = f"{1.0 / rate:.3g}"
    assert found.found == f"its clock goes {faster} times as fast as expected: say --speed {faster}"


@pytest.mark.parametrize(
    ("fraction", "severity"), [(0.03, Severity.WARNING), (0.2, Severity.ERROR)]
)
def test_lost_messages_are_counted(surgery: Surgery, fraction: float, severity: Severity) -> None:
    vehicle = surgery.admit()
    vehicle.faults.strike("link-loss", fraction=fraction, direction="downlink")
    found = named(surgery.examine())["loss"]
    assert found.severity is severity


@pytest.mark.parametrize(("delay_s", "severity"), [(0.1, Severity.WARNING), (0.3, Severity.ERROR)])
def test_a_slow_link_is_found(surgery: Surgery, delay_s: float, severity: Severity) -> None:
    vehicle = surgery.admit()
    vehicle.faults.strike("link-delay", delay_s=delay_s)
    assert named(surgery.examine())["round trip"].severity is severity


def test_who_does_not_answer_is_listened_to(surgery: Surgery) -> None:
    vehicle = surgery.admit()
    vehicle.faults.strike("link-loss", direction="uplink")
    assert errors(surgery.examine()) == ["answers"]
    assert surgery.now < 10.0


def test_streams_that_are_refused_are_missed(surgery: Surgery) -> None:
    vehicle = surgery.admit("ardupilot")
    vehicle.faults.strike("nack", command=511, result="denied")
    findings = surgery.examine()
    found = [finding.found for finding in findings if finding.check == "streams"]
    assert "ATTITUDE 0.0 Hz of 10 Hz" in found
    assert "SYS_STATUS 0.0 Hz of 1 Hz" in found
    assert "local position" in errors(findings)


@pytest.mark.parametrize(("key", "found"), [(None, "it signs what it says"), ("other", "frames")])
def test_a_vehicle_that_signs_wants_its_key(surgery: Surgery, key: str | None, found: str) -> None:
    surgery.admit(signing_key="secret")
    findings = surgery.examine(key=key_of(key) if key else None)
    assert found in named(findings)["signing"].found


def test_a_vehicle_with_our_key_is_healthy(surgery: Surgery) -> None:
    surgery.admit(signing_key="secret")
    assert surgery.examine(key=key_of("secret")) == []


def test_px4_over_udpout_is_bound_to_the_doctor(surgery: Surgery) -> None:
    surgery.admit(url="udpout://10.0.0.1:14580")
    assert "port" in named(surgery.examine())


def test_the_port_where_simulators_mix_is_named(surgery: Surgery) -> None:
    surgery.admit(url="udpin://0.0.0.0:14549")
    assert "port 14549" in named(surgery.examine())


# -- rangefinders and readiness ------------------------------------------------------------------


@BOTH
def test_missing_rangefinders_are_an_error_among_walls(surgery: Surgery, autopilot: str) -> None:
    vehicle = surgery.admit(autopilot)
    vehicle.faults.strike("rangefinder")
    found = named(surgery.examine())["rangefinders"]
    assert found.severity is Severity.ERROR
    assert found.found == "nothing from front, back, left, right, up, down"


def test_missing_rangefinders_are_a_warning_in_the_open(surgery: Surgery, tmp_path: Path) -> None:
    vehicle = surgery.admit(parameters=LOW_RETURN["px4"])
    vehicle.faults.strike("rangefinder")
    mission = hall_mission(tmp_path, flight={"height_m": 1.5, "open_air": True})
    for question in ({"is_open_air": True}, {"mission": mission}):
        findings = surgery.examine(**question)
        assert [(f.check, f.severity) for f in findings] == [("rangefinders", Severity.WARNING)]


@pytest.mark.parametrize(
    ("orientation", "cm", "check"),
    [(0, 0, "rangefinder dead"), (25, 300, "rangefinder down")],
)
def test_a_rangefinder_that_cannot_be_right_is_found(
    surgery: Surgery, orientation: int, cm: int, check: str
) -> None:
    vehicle = surgery.admit()
    vehicle.faults.strike("rangefinder")
    examination = surgery.begin(is_open_air=check == "rangefinder down")
    reading = wire.message("DISTANCE_SENSOR").pack
    while not examination.is_over(surgery.now):
        broken = reading(0, 1, 1, 0, 20, 800, cm, 0, 0, orientation, 0)
        examination.receive(URL, ("10.0.0.1", 1), broken, surgery.now)
        surgery.go_on(examination, until_s=surgery.now + 0.1)
    assert check in named(surgery.findings(examination))


@BOTH
def test_a_vehicle_that_would_not_arm_says_why(surgery: Surgery, autopilot: str) -> None:
    vehicle = surgery.admit(autopilot)
    surgery.pass_time(1.0)
    vehicle.faults.strike("gnss-loss")
    surgery.pass_time(30.0)
    findings = named(surgery.examine())
    assert "satellites" in findings
    assert "would not arm" in findings["ready to arm"].found


@pytest.mark.parametrize(
    ("frame", "found"),
    [
        ({"shared": "gnss"}, "frame.shared is gnss, and it has no fix in three dimensions"),
        (
            {"shared": "surveyed", "starts_m": {1: [0, 0, 0], 2: [5, 0, 0]}},
            "frame.starts_m lacks vehicle 7",
        ),
    ],
)
def test_a_vehicle_without_a_place_in_the_shared_frame_is_an_error(
    surgery: Surgery, tmp_path: Path, frame: dict[str, Any], found: str
) -> None:
    vehicle = surgery.admit(sysid=7)
    vehicle.faults.strike("gnss-loss")
    finding = named(surgery.examine(mission=hall_mission(tmp_path, frame=frame)))["shared frame"]
    assert (finding.severity, finding.found) == (Severity.ERROR, found)


def test_a_low_battery_is_an_error(surgery: Surgery) -> None:
    vehicle = surgery.admit()
    vehicle.faults.strike("battery", fraction=0.2)
    assert named(surgery.examine())["battery"].found == "20%, and it turns home at 25%"


# -- what nobody should send ---------------------------------------------------------------------


@BOTH
def test_no_message_stops_an_examination(surgery: Surgery, autopilot: str) -> None:
    surgery.admit(autopilot)
    examination = surgery.begin()
    rng = np.random.default_rng(7)
    for table in TABLES.values():
        for _ in range(5):
            values = random_values(table, rng)
            frame = wire.message(table.id).pack(0, 1, 1, *values)
            examination.receive(URL, ("10.0.0.1", 1), frame, 0.0)
    surgery.go_on(examination)
    assert report.as_json(examination, diagnose(examination), is_fit=False)


def test_noise_is_nobody() -> None:
    examination = Examination(Question([URL], patience_s=1.0))
    rng = np.random.default_rng(7)
    for step in range(200):
        examination.receive(URL, ("10.0.0.1", 1), rng.bytes(100), step * 0.01)
    assert examination.is_over(2.0)
    assert report.verdict(examination, diagnose(examination)) == "Nobody was heard."
