from __future__ import annotations

import math

import numpy as np
import pytest
from mock_client import (
    ACCEPTED,
    AP_GUIDED,
    AP_LAND,
    DENIED,
    FAILED,
    NAN,
    PERSONALITIES,
    POSITION,
    PX4_LAND,
    PX4_LOITER,
    PX4_OFFBOARD,
    Client,
    airborne,
    both,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.sensors.readings import PeerFix, VictimFix
from mock_vehicle.vehicle import Personality
from swarm_ctl import wire

# Boot, heartbeat, streams.


def test_px4_heartbeat_is_uninit_until_it_can_arm() -> None:
    client = Client("px4")
    client.fly(0.5)
    first = client.last("HEARTBEAT")
    assert (first.type, first.autopilot, first.base_mode) == (2, 12, 29)
    assert (first.custom_mode, first.system_status) == (PX4_LOITER, 0)
    client.fly(1.0)
    assert client.last("HEARTBEAT").system_status == 3
    client.set_mode(PX4_OFFBOARD)
    client.fly(1.0)
    silent = client.last("HEARTBEAT")
    assert (silent.base_mode, silent.system_status) == (1, 0)
    client.fly(2.0, vx=0.0)
    client.command(400, 1)
    client.fly(0.9, vx=0.0)
    assert (client.last("HEARTBEAT").base_mode, client.last("HEARTBEAT").system_status) == (145, 4)


def test_ardupilot_heartbeat_follows_the_record() -> None:
    client = Client("ardupilot", boot_s=None)
    client.fly(1.0)
    assert not client.times("HEARTBEAT")
    client.fly(0.5)
    assert client.last("HEARTBEAT").system_status == 1
    client.fly(41.0)
    ready = client.last("HEARTBEAT")
    assert (ready.autopilot, ready.base_mode, ready.custom_mode) == (3, 81, 0)
    assert ready.system_status == 3
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.fly(1.0)
    armed = client.last("HEARTBEAT")
    assert (armed.base_mode, armed.custom_mode, armed.system_status) == (217, 4, 3)
    client.command(22, 0, 0, 0, 0, 0, 0, 3.0)
    client.fly(5.0)
    assert client.last("HEARTBEAT").system_status == 4


def test_ardupilot_tells_a_mode_change_at_once_and_px4_does_not() -> None:
    for personality in PERSONALITIES:
        extra = {"ardupilot": 1, "px4": 0}[personality]
        client = Client(personality)
        client.fly(1.5)
        before = len(client.times("HEARTBEAT"))
        client.set_mode(AP_LAND if personality == "ardupilot" else PX4_LAND)
        assert len(client.times("HEARTBEAT")) - before == extra


@both
def test_heartbeats_come_once_a_second(personality: Personality) -> None:
    client = Client(personality)
    client.fly(10.0)
    assert np.diff(client.times("HEARTBEAT")) == pytest.approx([1.0] * 9, abs=1e-6)


def test_px4_streams_by_itself_and_ardupilot_waits_to_be_asked() -> None:
    px4, ardupilot = Client("px4"), Client("ardupilot")
    px4.fly(3.0)
    ardupilot.fly(3.0)
    assert {m.get_type() for _, m in ardupilot.heard} == {"HEARTBEAT"}
    assert {m.get_type() for _, m in px4.heard} >= {
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "SYS_STATUS",
        "EXTENDED_SYS_STATE",
        "BATTERY_STATUS",
        "DISTANCE_SENSOR",
    }
    assert len(px4.times("ATTITUDE")) == 30
    assert len(px4.times("EXTENDED_SYS_STATE")) == 15


@both
@pytest.mark.parametrize(("hz", "per_5_s"), [(2, 10), (5, 25), (10, 50), (50, 50), (4, 20)])
def test_an_interval_is_served_up_to_the_tick_rate(
    personality: Personality, hz: int, per_5_s: int
) -> None:
    client = Client(personality)
    client.fly(2.0)
    assert client.command(511, 30, 1e6 / hz) == [(511, ACCEPTED)]
    before = len(client.times("ATTITUDE"))
    client.fly(5.0)
    assert len(client.times("ATTITUDE")) - before == pytest.approx(per_5_s, abs=1)
    assert client.command(510, 30) == [(510, ACCEPTED)]
    assert client.last("MESSAGE_INTERVAL").interval_us == 1_000_000 // hz


@both
def test_an_interval_of_minus_one_stops_and_zero_restores(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    client.command(511, 30, 100_000)
    client.command(511, 30, -1)
    client.command(510, 30)
    assert client.last("MESSAGE_INTERVAL").interval_us == -1
    client.command(511, 30, 0)
    client.command(510, 30)
    default_us = 100_000 if personality == "px4" else -1
    assert client.last("MESSAGE_INTERVAL").interval_us == default_us


def test_intervals_are_refused_as_recorded() -> None:
    px4, ardupilot = Client("px4"), Client("ardupilot")
    assert px4.command(511, 9999, 1e5) == [(511, FAILED)]
    assert px4.command(511, 0, 1e5) == [(511, FAILED)]  # HEARTBEAT is strictly 1 Hz
    assert px4.command(510, 9999) == [(510, ACCEPTED)]
    assert px4.last("MESSAGE_INTERVAL").interval_us == -1
    assert ardupilot.command(511, 9999, 1e5) == [(511, DENIED)]
    assert ardupilot.command(511, 30, -5) == [(511, DENIED)]
    assert ardupilot.command(511, 30, 1e5, 1) == [(511, DENIED)]
    assert ardupilot.command(511, 30, 1000) == [(511, DENIED)]
    assert "".join(ardupilot.texts) == (
        "No ap_message for mavlink id (9999)"
        "Requested rate for message ID 30 too fast. Increase SCHED_LOOP_RATE"
    )
    assert ardupilot.command(510, 9999) == [(510, FAILED)]
    assert ardupilot.last("MESSAGE_INTERVAL").interval_us == 0
    assert ardupilot.command(511, 30, 120e6) == [(511, ACCEPTED)]
    ardupilot.command(510, 30)
    assert ardupilot.last("MESSAGE_INTERVAL").interval_us == 60_000_000


def test_request_data_stream_works_on_ardupilot_only() -> None:
    for personality in PERSONALITIES:
        streams = personality == "ardupilot"
        client = Client(personality)
        client.fly(2.0)
        client.command(511, 30, -1)
        client.heard.clear()
        client.send(mavlink.MAVLink_request_data_stream_message(7, 1, 0, 4, 1))
        client.fly(2.0)
        assert bool(client.times("ATTITUDE")) == streams
        assert not client.times("COMMAND_ACK")


@both
def test_sequence_numbers_have_no_gaps_per_component(personality: Personality) -> None:
    client = Client(personality)
    client.readings.peers[0].append(PeerFix(9, 4.0, (1.0, 0.0, 0.0), 0.0))
    client.command(511, 32, 1e5)
    client.fly(40.0)
    for compid in (1, 68):
        numbers = [m.get_seq() for _, m in client.heard if m.get_srcComponent() == compid]
        assert len(numbers) > 256
        assert set(np.diff(numbers) % 256) == {1}


# What stands in the messages.


@both
def test_the_estimate_is_truth_minus_home_plus_drift(personality: Personality) -> None:
    client = airborne(personality)
    client.command(511, 32, 1e5)
    client.readings.drift_ned_m[:] = (0.5, -0.25, 0.125)
    client.fly(1.0, vx=1.0)
    seen = client.last("LOCAL_POSITION_NED")
    north, east, down = client.dynamics.position_ned_m[0]
    assert [seen.x, seen.y, seen.z] == pytest.approx(
        [north - 3.0 + 0.5, east + 2.0 - 0.25, down + 0.125], abs=1e-5
    )
    assert seen.vx == pytest.approx(client.velocity[0], abs=1e-5)


@both
def test_a_position_setpoint_is_flown_in_the_estimated_frame(personality: Personality) -> None:
    client = airborne(personality)
    client.readings.drift_ned_m[:] = (1.0, 0.0, 0.0)
    client.fly(15.0, mask=POSITION, x=2.0, y=1.0, z=-4.0)
    assert client.dynamics.position_ned_m[0] == pytest.approx([3.0 + 1.0, -1.0, -4.0], abs=0.1)


@both
def test_six_rangefinders_come_together(personality: Personality) -> None:
    client = Client(personality)
    client.readings.ranges_m[0] = (1.0, 2.0, 3.004, math.inf, 5.0, 0.5)
    client.command(511, 132, 1e5)
    six = client.tick("DISTANCE_SENSOR")
    back = {"px4": 12, "ardupilot": 4}[personality]
    assert [m.orientation for m in six] == [0, back, 6, 2, 24, 25]
    assert [m.id for m in six] == [0, 1, 2, 3, 4, 5]
    assert [m.current_distance for m in six] == [100, 200, 300, 1001, 500, 50]
    assert {m.max_distance for m in six} == {1000}


@both
def test_the_ring_comes_on_request_alone(personality: Personality) -> None:
    client = Client(personality)
    client.readings.ring_m[0] = 3.0 + 0.05 * np.arange(72)
    client.readings.ring_m[0, 10:20] = math.inf
    client.fly(3.0)
    assert not client.times("OBSTACLE_DISTANCE")
    assert client.command(511, 330, 2e5) == [(511, ACCEPTED)]
    client.fly(2.0)
    assert len(client.times("OBSTACLE_DISTANCE")) in {10, 11}
    ring = client.last("OBSTACLE_DISTANCE")
    assert (ring.get_srcComponent(), ring.frame, ring.sensor_type) == (1, 12, 0)
    assert (ring.increment, ring.increment_f, ring.angle_offset) == (5, 5.0, 0.0)
    assert (ring.min_distance, ring.max_distance) == (0.2 * 100, 1000)
    expected = [300 + 5 * ray for ray in range(72)]
    expected[10:20] = [1001] * 10
    assert ring.distances == expected
    client.command(511, 330, -1)
    client.heard.clear()
    client.fly(1.0)
    assert not client.times("OBSTACLE_DISTANCE")


@both
def test_a_broken_ring_is_not_sent(personality: Personality) -> None:
    client = Client(personality)
    client.command(511, 330, 1e5)
    assert client.tick("OBSTACLE_DISTANCE")
    client.readings.ring_m[:] = math.nan
    assert not client.tick("OBSTACLE_DISTANCE")


@both
def test_ranges_and_rings_are_the_frames_that_the_codec_packs(personality: Personality) -> None:
    client = Client(personality)
    client.readings.ranges_m[0] = (1.0, 2.0, 3.004, math.inf, 5.0, math.nan)
    client.readings.ring_m[0] = 3.0 + 0.05 * np.arange(72)
    client.command(511, 132, 1e5)
    client.command(511, 330, 1e5)
    parser = wire.Parser(("DISTANCE_SENSOR", "OBSTACLE_DISTANCE"))
    frames = [frame for m in client.tick() for frame in parser.feed(bytes(m.get_msgbuf()))]
    assert [frame.id for frame in frames] == [132] * 5 + [330]
    for frame in frames:
        pack = wire.message(frame.id).pack
        assert frame.raw == pack(frame.seq, frame.sysid, frame.compid, *frame.values)


@both
def test_a_range_that_fits_no_field_is_nothing_in_range(personality: Personality) -> None:
    client = Client(personality)
    client.readings.range_max_m = 900.0
    client.readings.ranges_m[0] = client.readings.ring_m[0, :6] = (1.0, 654.0, 656.0, 800, 900, 5)
    client.command(511, 132, 1e5)
    client.command(511, 330, 1e5)
    heard = client.tick()
    six = [m.current_distance for m in heard if m.get_type() == "DISTANCE_SENSOR"]
    (ring,) = (m.distances for m in heard if m.get_type() == "OBSTACLE_DISTANCE")
    assert six == ring[:6] == [100, 65400, 65401, 65401, 65401, 500]
    assert ring[6:] == [65401] * 66


@both
def test_a_peer_comes_from_the_radio_with_its_bearing(personality: Personality) -> None:
    client = Client(personality)
    directions = [(0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.6, 0.0, -0.8)]
    client.readings.peers[0] += [PeerFix(20 + i, 12.34, d, 0.0) for i, d in enumerate(directions)]
    fixes = [m for m in client.tick("DISTANCE_SENSOR") if m.get_srcComponent() == 68]
    assert [(m.id, m.orientation, m.current_distance) for m in fixes] == [
        (20, 100, 1234),
        (21, 100, 1234),
        (22, 100, 1234),
    ]
    for fix, direction in zip(fixes, directions, strict=True):
        w, x, y, z = fix.quaternion
        turned = (w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y))
        assert turned == pytest.approx(direction, abs=1e-6)


@both
def test_a_fix_that_comes_late_tells_when_it_was_taken(personality: Personality) -> None:
    client = Client(personality)
    client.tick()
    client.readings.peers[0] += [PeerFix(20, 2.0, (1.0, 0.0, 0.0), client.now - 0.05)]
    (fix,) = (m for m in client.tick("DISTANCE_SENSOR") if m.get_srcComponent() == 68)
    age_s = client.now - client.vehicle.autopilot.booted_at - fix.time_boot_ms / 1e3
    assert age_s == pytest.approx(0.15, abs=0.002)  # and a tick has passed since


@both
def test_a_victim_is_a_landing_target(personality: Personality) -> None:
    client = Client(personality)
    client.readings.victims[0].append(VictimFix(3, 1.0, -2.0, 2.0))
    (target,) = client.tick("LANDING_TARGET")
    assert (target.target_num, target.frame, target.position_valid) == (3, 12, 1)
    assert (target.x, target.y, target.z, target.distance) == (1.0, -2.0, 2.0, 3.0)
    assert target.get_srcComponent() == 1


@both
def test_the_battery_is_told_twice(personality: Personality) -> None:
    client = Client(personality)
    client.readings.battery_fraction[:] = 0.42
    client.readings.battery_voltage_v[:] = 14.7
    client.readings.battery_current_a[:] = 12.5
    client.command(511, 1, 1e5)
    client.command(511, 147, 1e5)
    client.tick()
    status, battery = client.last("SYS_STATUS"), client.last("BATTERY_STATUS")
    told_mv = {"ardupilot": 11_025, "px4": 14_175}[personality]
    assert status.voltage_battery == battery.voltages[0] == told_mv, "as of their own full packs"
    assert status.current_battery == battery.current_battery == 1250
    assert status.battery_remaining == battery.battery_remaining == 42


@both
def test_the_prearm_bit_shows_when_it_may_arm(personality: Personality) -> None:
    client = Client(personality)
    client.command(511, 1, 1e5)
    client.tick()
    assert not client.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000
    client.fly(1.5)
    assert client.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000


@both
def test_a_requested_message_comes_after_the_acknowledgement_on_ardupilot_alone(
    personality: Personality,
) -> None:
    client = Client(personality)
    client.send(mavlink.MAVLink_command_long_message(7, 1, 512, 0, 148, *(NAN,) * 6))
    kinds = [m.get_type() for m in client.tick()]
    acknowledged_first = kinds.index("COMMAND_ACK") < kinds.index("AUTOPILOT_VERSION")
    assert acknowledged_first == (personality == "ardupilot")
    version = client.last("AUTOPILOT_VERSION")
    assert version.capabilities == {"px4": 59647, "ardupilot": 64495}[personality]
    assert bytes(version.uid2)[-2:] == (4711).to_bytes(2, "big")
    refusal = {"px4": DENIED, "ardupilot": FAILED}[personality]
    assert client.command(512, 9999) == [(512, refusal)]
    assert client.command(520) == [(520, ACCEPTED)]


@both
def test_frames_that_nobody_takes_do_not_pile_up(personality: Personality) -> None:
    client = Client(personality)
    for moment in range(10_000):
        client.send(mavlink.MAVLink_timesync_message(0, moment))
    frames = client.vehicle.take()
    assert len(frames) == 4096
    assert wire.message("TIMESYNC").unpack(frames[-1][10:-2]).ts1 == 9999
