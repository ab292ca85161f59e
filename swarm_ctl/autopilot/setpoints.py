"""Setpoints from named values: what is not given is not used, and masks make themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from swarm_ctl.autopilot.base import Autopilot
from swarm_ctl.model import Vec3

MOST = 1000.0
"""Beyond it a recorded ArduPilot stopped (2000 m/s), or died (1e9 m)."""
_UNUSED = Vec3(0.0, 0.0, 0.0)


class Frame(IntEnum):
    """MAV_FRAME of a setpoint."""

    LOCAL_NED = 1
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9


TURNED = frozenset({Frame.BODY_NED, Frame.BODY_OFFSET_NED})
"""Frames whose axes turn with the vehicle's heading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What a vehicle is asked to follow; None is left to the autopilot.

    Vectors are whole: PX4 rejects one with an axis left out, and for ArduPilot one ignored axis
    is an ignored vector.
    """

    position_m: Vec3 | None = None
    """In the vehicle's own local frame."""
    velocity_m_s: Vec3 | None = None
    """Along the axes of the frame; with a position, the speed on the way there."""
    acceleration_m_s2: Vec3 | None = None
    yaw_rad: float | None = None
    """Heading, clockwise from north."""
    yaw_rate_rad_s: float | None = None
    frame: Frame = Frame.LOCAL_NED

    @property
    def mask(self) -> int:
        """POSITION_TARGET_TYPEMASK: a bit for everything that is not used."""
        return (
            0x007 * (self.position_m is None)
            | 0x038 * (self.velocity_m_s is None)
            | 0x1C0 * (self.acceleration_m_s2 is None)
            | 0x400 * (self.yaw_rad is None)
            | 0x800 * (self.yaw_rate_rad_s is None)
        )

    @property
    def numbers(self) -> tuple[float, ...]:
        """The eleven numbers of the message; 0 for what is not used, as NaN kills ArduPilot."""
        return (
            *(self.position_m or _UNUSED),
            *(self.velocity_m_s or _UNUSED),
            *(self.acceleration_m_s2 or _UNUSED),
            self.yaw_rad or 0.0,
            self.yaw_rate_rad_s or 0.0,
        )

    def refusal(self, pilot: Autopilot | None = None) -> str:
        """Say why it may not be sent: it would not be flown as it is meant; empty when it would.

        Without a pilot, the rules that hold for both.
        """
        vectors = self.position_m, self.velocity_m_s, self.acceleration_m_s2
        position, velocity, acceleration = (vector is not None for vector in vectors)
        moves, turned = self.frame is not Frame.LOCAL_NED, self.frame in TURNED
        sane = all(math.isfinite(number) and abs(number) < MOST for number in self.numbers)
        known = pilot is None or self.frame in pilot.setpoint_frames
        rules = {
            f"every number must be one, and below {MOST:.0f}": not sane,
            "nothing to follow: one stops, the other counts no setpoint": not any(
                (position, velocity, acceleration)
            ),
            "a position in a frame that moves is another offset each time": moves and position,
            "accelerations are for the local frame": moves and acceleration,
            "a heading in a turned frame means something else to each autopilot": turned
            and self.yaw_rad is not None,
            f"this autopilot does not take frame {self.frame.name}": not known,
            "ArduPilot stops at a position with an acceleration and no velocity": position
            and acceleration
            and not velocity,
        }
        return next((words for words, is_broken in rules.items() if is_broken), "")
