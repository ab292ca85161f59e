from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import pytest
from mock_client import NAN, Client, both
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.autopilot.parameter_files import ParameterError
from mock_vehicle.autopilot.parameters import ARDUPILOT, DATA, PX4, Dialect, read_values, table
from mock_vehicle.fleet import Fleet
from mock_vehicle.vehicle import Personality
from mock_vehicle.world.field import open_field

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
UNASKED = 65535


class Station(Client):
    """A client that talks of parameters as ground stations do."""

    def set(self, name: str, value: float, kind: int = REAL32, system: int = 7) -> list[Any]:
        """Send PARAM_SET and give the answers that leave at once."""
        message = mavlink.MAVLink_param_set_message(system, 1, name.encode(), value, kind)
        return self.answers(self.send(message))

    def set_int(self, name: str, value: int) -> list[Any]:
        """Set an integer in the way of its autopilot."""
        px4 = self.vehicle.personality == "px4"
        return self.set(name, as_float(value) if px4 else value, INT32)

    def read(self, name: str = "", index: int = -1, system: int = 7) -> list[Any]:
        message = mavlink.MAVLink_param_request_read_message(system, 1, name.encode(), index)
        return self.answers(self.send(message))

    def value(self, name: str) -> float:
        (answer,) = self.read(name)
        return as_int(answer.param_value) if self.is_bytewise(answer) else answer.param_value

    def is_bytewise(self, answer: Any) -> bool:
        return self.vehicle.personality == "px4" and answer.param_type == INT32

    def ask_for_all(self) -> None:
        self.send(mavlink.MAVLink_param_request_list_message(7, 1))

    def answers(self, _: object = None) -> list[Any]:
        """Take the PARAM_VALUEs that leave without waiting for a tick."""
        heard = [m for frame in self.vehicle.take() for m in self.oracle.parse_buffer(frame) or []]
        self.heard += [(self.now, message) for message in heard]
        return [m for m in heard if m.get_type() == "PARAM_VALUE"]


def as_float(value: int) -> float:
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


def as_int(value: float) -> int:
    return int(struct.unpack("<i", struct.pack("<f", value))[0])


# Lists.


@both
def test_a_list_gives_every_parameter_once_and_in_order(personality: Personality) -> None:
    station = Station(personality)
    station.ask_for_all()
    listed = station.answers()
    station.fly(2.0)
    listed += [m for _, m in station.heard if m.get_type() == "PARAM_VALUE"][len(listed) :]
    if personality == "px4":
        first = listed.pop(0)
        assert (first.param_id, first.param_type, first.param_index) == ("_HASH_CHECK", 5, UNASKED)
    count = listed[0].param_count
    assert [m.param_index for m in listed] == list(range(count))
    assert {m.param_count for m in listed} == {count}
    assert len({m.param_id for m in listed}) == count
    assert count == (
        1349 if personality == "ardupilot" else len(station.vehicle.autopilot.parameters)
    )


def test_an_ardupilot_list_has_the_recorded_types_and_says_what_flies_here() -> None:
    station = Station("ardupilot")
    station.ask_for_all()
    station.fly(2.0)
    kinds = [m.param_type for _, m in station.heard if m.get_type() == "PARAM_VALUE"]
    assert [kinds.count(kind) for kind in (REAL32, INT8, INT16, INT32)] == [553, 417, 283, 96]
    firmware, board, frame = station.texts
    assert (firmware, frame) == ("ArduCopter V4.7.0-dev (2598e9d4)", "Frame: QUAD/PLUS")
    assert board.startswith("M")
    assert len(board) == 32


@pytest.mark.parametrize(("personality", "per_s"), [("px4", 1000), ("ardupilot", 1660)])
def test_a_list_comes_at_the_recorded_pace(personality: Personality, per_s: float) -> None:
    station = Station(personality)
    station.ask_for_all()
    station.answers()
    assert len(station.tick("PARAM_VALUE")) == pytest.approx(
        min(0.09 * per_s, len(station.vehicle.autopilot.parameters)), abs=0.02 * per_s
    )


def test_a_second_request_starts_the_list_again() -> None:
    station = Station("ardupilot")
    station.ask_for_all()
    station.fly(0.3)
    station.ask_for_all()
    assert station.tick("PARAM_VALUE")[0].param_index == 0
    station.fly(1.0)
    assert station.last("PARAM_VALUE").param_index == 1348


def test_px4_stops_a_list_for_a_ground_station_that_knows_the_checksum() -> None:
    station = Station("px4")
    station.ask_for_all()
    (first,) = station.answers()
    station.set("_HASH_CHECK", first.param_value, 5)
    assert station.tick("PARAM_VALUE") == []


def test_the_checksum_of_px4_changes_with_any_value() -> None:
    station = Station("px4")
    (before,) = station.read("_HASH_CHECK")
    station.set("MPC_XY_P", 0.9)
    (after,) = station.read("_HASH_CHECK")
    assert before.param_value != after.param_value
    station.set("MPC_XY_P", 0.95)
    assert station.read("_HASH_CHECK")[0].param_value == before.param_value


# Reading.


@pytest.mark.parametrize(
    ("personality", "name", "kind", "value"),
    [
        ("px4", "COM_OF_LOSS_T", REAL32, 1.0),
        ("px4", "COM_DL_LOSS_T", INT32, 10),
        ("px4", "COM_FLTMODE1", INT32, -1),
        ("ardupilot", "GUID_TIMEOUT", REAL32, 3.0),
        ("ardupilot", "RTL_LOIT_TIME", INT32, 5000),
        ("ardupilot", "LAND_SPEED", INT16, 50),
        ("ardupilot", "FS_GCS_ENABLE", INT8, 0),
        ("ardupilot", "BATT_SERIAL_NUM", INT32, -1),
    ],
)
def test_a_parameter_has_its_recorded_default_and_type(
    personality: Personality, name: str, kind: int, value: float
) -> None:
    station = Station(personality)
    assert station.value(name) == value
    (answer,) = station.read(name)
    assert answer.param_type == kind
    assert answer.param_id == name


@both
def test_the_index_comes_with_what_was_asked_by_index_or_on_px4_by_name(
    personality: Personality,
) -> None:
    station = Station(personality)
    (by_index,) = station.read(index=10)
    assert by_index.param_index == 10
    (by_name,) = station.read(by_index.param_id)
    assert by_name.param_value == by_index.param_value
    assert by_name.param_index == (10 if personality == "px4" else UNASKED)


def test_ardupilot_keeps_the_recorded_order() -> None:
    (answer,) = Station("ardupilot").read(index=10)
    assert answer.param_id == "RTL_LOIT_TIME"


@both
@pytest.mark.parametrize("index", [9999, 32767, -2])
def test_an_index_beyond_the_list_is_met_with_silence(personality: Personality, index: int) -> None:
    assert Station(personality).read(index=index) == []


@both
def test_an_unknown_parameter_is_met_with_silence(personality: Personality) -> None:
    station = Station(personality)
    assert station.read("SYSID_THISMAV") == []
    assert station.set("NO_SUCH_PARAM", 1.0) == []
    assert station.tick("PARAM_VALUE") == []


def test_ardupilot_takes_lower_case_and_answers_in_it_and_px4_does_not() -> None:
    (answer,) = Station("ardupilot").read("guid_timeout")
    assert (answer.param_id, answer.param_value) == ("guid_timeout", 3.0)
    assert Station("px4").read("mis_takeoff_alt") == []


@both
def test_parameters_of_another_system_are_none_of_its_business(personality: Personality) -> None:
    station = Station(personality)
    assert station.read(index=0, system=9) == []
    assert len(station.read(index=0, system=0)) == (1 if personality == "ardupilot" else 0)
    assert station.set("RTL_TYPE" if personality == "px4" else "LAND_SPEED", 1, system=9) == []


# Setting.


@both
def test_a_new_value_is_told_at_once_and_stays(personality: Personality) -> None:
    name = "COM_OF_LOSS_T" if personality == "px4" else "GUID_TIMEOUT"
    station = Station(personality)
    (echo,) = station.set(name, 2.5)
    assert (echo.param_id, echo.param_value, echo.param_type) == (name, 2.5, REAL32)
    assert station.value(name) == 2.5
    (echo,) = station.set(name, 2.5)
    assert echo.param_value == 2.5


def test_px4_hides_the_bits_of_an_integer_in_the_float() -> None:
    station = Station("px4")
    (echo,) = station.set("NAV_DLL_ACT", as_float(99), INT32)
    assert as_int(echo.param_value) == 99
    assert station.value("NAV_DLL_ACT") == 99


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [("NAV_DLL_ACT", 1.0, REAL32), ("NAV_DLL_ACT", 1e-45, 1), ("MIS_TAKEOFF_ALT", 4.0, INT32)],
)
def test_px4_ignores_a_value_of_the_wrong_type(name: str, value: float, kind: int) -> None:
    station = Station("px4")
    before = station.value(name)
    assert station.set(name, value, kind) == []
    assert station.value(name) == before


def test_px4_stores_even_nan() -> None:
    station = Station("px4")
    (echo,) = station.set("MIS_TAKEOFF_ALT", NAN)
    assert math.isnan(echo.param_value)
    assert math.isnan(station.value("MIS_TAKEOFF_ALT"))


@pytest.mark.parametrize(
    ("name", "sent", "stored"),
    [
        ("LOG_DISARMED", 1.7, 1),
        ("WP_YAW_BEHAVIOR", 99, 99),
        ("WP_YAW_BEHAVIOR", 300, 127),
        ("WP_YAW_BEHAVIOR", -300, -128),
        ("LAND_SPEED", 1e9, 32767),
    ],
)
def test_ardupilot_cuts_a_value_to_what_the_type_can_hold(
    name: str, sent: float, stored: float
) -> None:
    (echo,) = Station("ardupilot").set(name, sent)
    assert (echo.param_value, echo.param_index) == (stored, UNASKED)


@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf])
def test_ardupilot_ignores_what_is_no_number(value: float) -> None:
    station = Station("ardupilot")
    assert station.set("GUID_TIMEOUT", value) == []
    assert station.value("GUID_TIMEOUT") == 3.0


def test_px4_repeats_a_change_ten_milliseconds_later_and_no_news_not_at_all() -> None:
    station = Station("px4")
    station.set("COM_OF_LOSS_T", 2.5)
    assert [m.param_id for m in station.tick("PARAM_VALUE")] == ["COM_OF_LOSS_T"]
    station.set("COM_OF_LOSS_T", 2.5)
    assert station.tick("PARAM_VALUE") == []


def test_a_change_on_one_link_of_px4_is_heard_on_the_other() -> None:
    station = Station("px4", rates="full")
    station.set("COM_OF_LOSS_T", 2.5)
    station.vehicle.tick(0.005)
    assert b"COM_OF_LOSS_T" not in b"".join(station.vehicle.take(1))
    station.vehicle.tick(0.01)
    assert b"COM_OF_LOSS_T" in b"".join(station.vehicle.take(1))


@both
def test_a_new_sysid_counts_after_a_reboot_which_keeps_all_parameters(
    personality: Personality,
) -> None:
    station = Station(personality)
    name = "MAV_SYS_ID" if personality == "px4" else "MAV_SYSID"
    assert station.value(name) == 7
    station.set_int(name, 9)
    station.fly(1.0)
    assert station.last("HEARTBEAT").get_srcSystem() == 7
    station.vehicle.autopilot.reboot(station.now)
    station.fly(3.0)
    assert station.last("HEARTBEAT").get_srcSystem() == 9
    assert station.read(name, system=7) == []
    (answer,) = station.read(name, system=9)
    assert answer.get_srcSystem() == 9


@both
def test_a_sysid_that_is_none_is_stored_and_never_flown(personality: Personality) -> None:
    station = Station(personality)
    station.set_int("MAV_SYS_ID" if personality == "px4" else "MAV_SYSID", 0)
    station.vehicle.autopilot.reboot(station.now)
    assert station.vehicle.autopilot.sysid == 7


# Unasked.


@both
def test_a_boot_tells_what_it_found_out_and_only_where_all_is_told(
    personality: Personality,
) -> None:
    station = Station(personality, rates="full", boot_s=None)
    station.fly(25.0)
    name = "INS_GYR_ID" if personality == "ardupilot" else "CAL_BARO0_ID"
    told = [at for at, m in station.heard if m.get_type() == "PARAM_VALUE" and m.param_id == name]
    recorded = [1.93, 2.46] if personality == "ardupilot" else [1.22, 5.69]
    assert told == pytest.approx(recorded, abs=0.11)
    lean = Station(personality)
    lean.fly(25.0)
    assert lean.times("PARAM_VALUE") == []


def test_ardupilot_counts_the_seconds_of_its_life_and_of_each_flight() -> None:
    station = Station("ardupilot", rates="full")
    station.fly(29.0)
    station.take_off()
    took_off_at = station.now
    station.command(21)
    station.fly_until(lambda: not station.vehicle.armed)
    station.fly(0.5)
    told = [m for _, m in station.heard if m.get_type() == "PARAM_VALUE"]
    lives = [m.param_value for m in told if m.param_id == "STAT_RUNTIME"]
    assert lives[0] == 30
    assert lives[-1] == pytest.approx(station.now, abs=2.0)
    in_air_s = next(m.param_value for m in reversed(told) if m.param_id == "STAT_FLTTIME")
    assert station.now - took_off_at < in_air_s < station.now - 30.0
    assert told[-1].param_id == "MOT_THST_HOVER"


# From the start.


@both
def test_a_vehicle_may_start_with_parameters_of_its_own(personality: Personality) -> None:
    name = "COM_OF_LOSS_T" if personality == "px4" else "GUID_TIMEOUT"
    station = Station(personality, parameters={name: 0.5})
    assert station.value(name) == 0.5


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("COM_OF_LOS_T", 1.0, "there is no parameter COM_OF_LOS_T, perhaps COM_OF_LOSS_T?"),
        ("NAV_DLL_ACT", 0.5, "NAV_DLL_ACT cannot be 0.5, it takes a whole number"),
        ("NAV_DLL_ACT", 2.0**31, "NAV_DLL_ACT cannot be 2.14748e+09, it has 32 bits"),
        ("COM_OF_LOSS_T", NAN, "COM_OF_LOSS_T cannot be nan"),
        ("COM_OF_LOSS_T", 1e300, "COM_OF_LOSS_T cannot be 1e+300"),
    ],
)
def test_a_parameter_that_cannot_be_is_named(name: str, value: float, reason: str) -> None:
    with pytest.raises(ParameterError, match=r"^px4: ") as error:
        Station("px4", parameters={name: value})
    assert error.value.reason == reason


# Files.


def refusal(station: Station, opcode: int, path: bytes = b"") -> bytes:
    """Send a file transfer request with sequence number 65535, and give the answer's payload."""
    header = struct.pack("<HBBBBBxI", 65535, 3, opcode, len(path), 0, 0, 42)
    payload = list((header + path).ljust(251, b"\0"))
    station.send(mavlink.MAVLink_file_transfer_protocol_message(0, 7, 1, payload))
    station.answers()
    answer = station.last("FILE_TRANSFER_PROTOCOL")
    assert (answer.target_system, answer.target_component) == (7, 191)
    assert bytes(answer.payload[:2]) == b"\0\0"
    assert answer.payload[5] == opcode
    return bytes(answer.payload)


@both
@pytest.mark.parametrize(("opcode", "error"), [(4, 10), (5, 4), (15, 4), (7, 7), (200, 7)])
def test_a_file_transfer_is_refused_at_once(
    personality: Personality, opcode: int, error: int
) -> None:
    station = Station(personality)
    payload = refusal(station, opcode, b"@PARAM/param.pck?withdefaults=1")
    assert (payload[3], payload[4], payload[12]) == (129, 1, error)


def test_ardupilot_refuses_to_list_a_directory_as_recorded() -> None:
    payload = refusal(Station("ardupilot"), 3, b"@PARAM")
    assert payload[3:6] + payload[12:14] == bytes([129, 2, 3, 2, 0])


@both
@pytest.mark.parametrize("opcode", [1, 2])
def test_sessions_that_were_never_open_are_closed(personality: Personality, opcode: int) -> None:
    payload = refusal(Station(personality), opcode)
    assert payload[3:5] == bytes([128, 0])


@both
def test_answers_of_file_transfers_are_not_answered(personality: Personality) -> None:
    station = Station(personality)
    with pytest.raises(StopIteration):
        refusal(station, 129)


# Parameter files.


BOTH_FILES = {
    "MAVProxy": "# a comment\nRTL_ALT 2000\nGUID_TIMEOUT   1.5 # seconds\n\n",
    "Mission Planner": "#NOTE: 22.11.2026\r\nRTL_ALT,2000\r\nGUID_TIMEOUT,1.5\r\n",
    "QGroundControl": "# Vehicle-Id Component-Id Name Value Type\n"
    "1\t1\tRTL_ALT\t2000\t6\n1\t1\tGUID_TIMEOUT\t1.500000000000000000\t9\n",
}


@pytest.mark.parametrize("text", BOTH_FILES.values(), ids=BOTH_FILES)
def test_a_parameter_file_is_read_as_its_ground_station_writes_it(
    text: str, tmp_path: Path
) -> None:
    file = tmp_path / "my.param"
    file.write_bytes(text.encode())
    assert read_values(file, [ARDUPILOT]) == {"RTL_ALT": 2000.0, "GUID_TIMEOUT": 1.5}


@pytest.mark.parametrize("dialect", [PX4, ARDUPILOT])
def test_a_file_of_all_default_parameters_changes_nothing(dialect: Dialect) -> None:
    values = read_values(DATA / f"{dialect.name}.param", [dialect])
    assert values == dict(table(dialect).defaults)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("RTL_ALTT 3", ":2: there is no parameter RTL_ALTT, perhaps RTL_ALT?"),
        ("NOTHING_LIKE_IT 3", ":2: there is no parameter NOTHING_LIKE_IT"),
        ("RTL_ALT high", ":2: RTL_ALT cannot be 'high', it takes a number"),
        ("RTL_ALT 1.5", ":2: RTL_ALT cannot be 1.5, it takes a whole number"),
        ("LAND_SPEED 40000", ":2: LAND_SPEED cannot be 40000, it has 16 bits"),
        ("GUID_TIMEOUT nan", ":2: GUID_TIMEOUT cannot be nan"),
        ("RTL_ALT", ":2: 'RTL_ALT' is not NAME VALUE"),
        ("1 1 RTL_ALT 15 real", ":2: RTL_ALT cannot be '15', it takes a number"),
    ],
)
def test_a_bad_line_of_a_parameter_file_is_named(line: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "my.param"
    file.write_text(f"GUID_TIMEOUT 1\n{line}\n")
    with pytest.raises(ParameterError) as error:
        read_values(file, [ARDUPILOT])
    assert str(error.value) == f"{file}{sentence}"


def test_each_vehicle_of_a_mixed_fleet_takes_the_parameters_that_it_has() -> None:
    values = {"RTL_ALT": 2000.0, "RTL_RETURN_ALT": 20.0}
    fleet = Fleet(open_field(), ["px4", "ardupilot", "px4"], seed=1, parameters=values)
    first, second, third = (vehicle.autopilot.parameters for vehicle in fleet.vehicles)
    assert (first["RTL_RETURN_ALT"], third["RTL_RETURN_ALT"], second["RTL_ALT"]) == (20, 20, 2000)
    assert "RTL_ALT" not in first
    with pytest.raises(ParameterError, match="there is no parameter RTL_ALT"):
        Fleet(open_field(), ["px4", "px4"], seed=1, parameters=values)


def test_a_fleet_numbers_its_vehicles_whatever_the_parameters_say() -> None:
    fleet = Fleet(open_field(), ["px4", "px4"], seed=1, parameters={"MAV_SYS_ID": 1})
    assert [vehicle.autopilot.sysid for vehicle in fleet.vehicles] == [1, 2]
