"""Setpoints from named values, beside what two real autopilots were recorded to do with masks."""

import math
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl import wire
from swarm_ctl.agent.sender import Sender
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.base import Autopilot
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.autopilot.setpoints import Frame, Target
from swarm_ctl.frames import wrap_rad
from swarm_ctl.model import Setpoint, Vec3

MESSAGE = "SET_POSITION_TARGET_LOCAL_NED"
AHEAD = Vec3(1.0, 0.0, 0.0)
NAN = math.nan
BOTH = pytest.mark.parametrize("pilot", [PX4, ARDUPILOT])

FLOWN = {
    # reference/*/behaviour.json, type_mask: what was used, its mask, who flew it
    "velocity and heading": (Target(velocity_m_s=AHEAD, yaw_rad=0.0), 0x9C7),
    "velocity": (Target(velocity_m_s=AHEAD), 0xDC7),
    "velocity and turn": (Target(velocity_m_s=AHEAD, yaw_rate_rad_s=0.5), 0x5C7),
    "position": (Target(position_m=AHEAD), 0xDF8),
    "position and velocity": (Target(position_m=AHEAD, velocity_m_s=AHEAD), 0xDC0),
    "velocity and acceleration": (Target(velocity_m_s=AHEAD, acceleration_m_s2=AHEAD), 0xC07),
    "acceleration": (Target(acceleration_m_s2=AHEAD), 0xC3F),
    "everything": (
        Target(
            position_m=AHEAD,
            velocity_m_s=AHEAD,
            acceleration_m_s2=AHEAD,
            yaw_rad=1.0,
            yaw_rate_rad_s=0.1,
        ),
        0x000,
    ),
}
GROUPS = (0x007, 0x038, 0x1C0, 0x400, 0x800)


def sent(frame: bytes) -> wire.Frame:
    (heard,) = wire.Parser([MESSAGE]).feed(frame)
    return heard


@BOTH
@pytest.mark.parametrize("what", FLOWN)
def test_what_was_flown_as_meant_has_the_recorded_mask(what: str, pilot: Autopilot) -> None:
    target, mask = FLOWN[what]
    assert target.refusal(pilot) == ""
    assert sent(Sender(1).target(target, 2.5, pilot)).values.type_mask == mask


@BOTH
@pytest.mark.parametrize("used", list(product(*[[None, AHEAD]] * 3, [None, 1.0])))
def test_no_mask_ignores_a_part_of_a_vector(
    used: tuple[Vec3 | None, Vec3 | None, Vec3 | None, float | None], pilot: Autopilot
) -> None:
    position, velocity, acceleration, yaw = used
    target = Target(
        position_m=position, velocity_m_s=velocity, acceleration_m_s2=acceleration, yaw_rad=yaw
    )
    assert all(target.mask & group in {0, group} for group in GROUPS)
    stops = (position and acceleration and not velocity) or not any(used[:3])
    assert bool(target.refusal(pilot)) == bool(stops)


@pytest.mark.parametrize(
    ("frame", "pilots"),
    [
        (Frame.LOCAL_NED, {PX4.name, ARDUPILOT.name}),
        (Frame.BODY_NED, {PX4.name, ARDUPILOT.name}),
        (Frame.LOCAL_OFFSET_NED, {ARDUPILOT.name}),
        (Frame.BODY_OFFSET_NED, {ARDUPILOT.name}),
    ],
)
def test_a_frame_that_an_autopilot_does_not_know_is_refused(frame: Frame, pilots: set[str]) -> None:
    target = Target(velocity_m_s=AHEAD, frame=frame)
    assert {pilot.name for pilot in (PX4, ARDUPILOT) if not target.refusal(pilot)} == pilots


def test_a_position_in_a_frame_that_moves_would_run_away() -> None:
    assert "offset" in Target(position_m=AHEAD, frame=Frame.LOCAL_OFFSET_NED).refusal(ARDUPILOT)
    assert "offset" in Target(position_m=AHEAD, frame=Frame.BODY_NED).refusal(PX4)
    heading = Target(velocity_m_s=AHEAD, yaw_rad=1.0, frame=Frame.BODY_NED)
    assert "heading" in heading.refusal()


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf, 2000.0, 1e9])
def test_no_number_that_stops_or_kills_an_autopilot_is_sent(bad: float) -> None:
    for target in (
        Target(velocity_m_s=Vec3(bad, 0.0, 0.0)),
        Target(position_m=Vec3(0.0, bad, 0.0)),
        Target(velocity_m_s=AHEAD, yaw_rad=bad),
        Target(velocity_m_s=AHEAD, yaw_rate_rad_s=bad),
    ):
        with pytest.raises(ValueError, match="every number"):
            Sender(1).target(target, 0.0)


@given(
    st.tuples(*[st.floats(-50.0, 50.0) | st.just(NAN) | st.just(math.inf)] * 3),
    st.floats(-99.0, 99.0) | st.just(NAN) | st.just(-math.inf),
    st.floats(0.0, 1e9),
)
def test_whatever_a_planner_wants_every_number_on_the_wire_is_one(
    velocity: tuple[float, float, float], yaw_rad: float, now: float
) -> None:
    values = sent(Sender(7).setpoint(Setpoint(Vec3(*velocity), yaw_rad), now)).values
    assert all(math.isfinite(number) for number in values)
    if all(map(math.isfinite, velocity)):
        assert values[5 + 3 : 5 + 6] == pytest.approx(velocity, rel=1e-6, abs=1e-30)
    else:
        assert values[5 + 3 : 5 + 6] == (0.0, 0.0, 0.0)
    assert values.type_mask == (0x9C7 if math.isfinite(yaw_rad) else 0xDC7)


@given(*[st.floats(-100.0, 100.0)] * 5)
def test_what_is_sent_in_flight_is_the_target_that_it_stands_for(
    x: float, y: float, z: float, yaw_rad: float, now: float
) -> None:
    velocity, now = Vec3(x + 0.0, y + 0.0, z + 0.0), abs(now)  # no minus before a zero
    sent = Sender(1).setpoint(Setpoint(velocity, yaw_rad), now)
    assert sent == Sender(1).target(Target(velocity_m_s=velocity, yaw_rad=wrap_rad(yaw_rad)), now)
