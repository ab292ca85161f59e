"""What all sensors of the fleet say in one telemetry tick; written by sensors and radio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.sensors.gnss import Reception

Floats = NDArray[np.float64]


class PeerFix(NamedTuple):
    """A heard peer, as the radio measures it."""

    sysid: int
    range_m: float
    direction_body: tuple[float, float, float]
    """Unit vector towards the peer, body FRD."""
    time_s: float
    """When it was measured, mission time."""


class VictimFix(NamedTuple):
    """A victim, as the infrared sensor sees it: body FRD, metres."""

    target_num: int
    x_m: float
    y_m: float
    z_m: float


@dataclass
class Readings:
    """One row or one list per vehicle, in the order of the fleet."""

    ranges_m: Floats
    """Shape (n, 6): front, back, left, right, up, down; inf where nothing is within range, NaN
    for a sensor that does not report."""
    ring_m: Floats
    """Shape (n, 72): level rays 5 degrees apart, clockwise from the nose; inf and NaN as above."""
    range_max_m: float
    """Farther than this the rangefinders see nothing."""
    range_min_m: float
    """Nearer than this the rangefinders are blind."""
    battery_fraction: Floats
    """Shape (n,): charge left, 0..1."""
    battery_voltage_v: Floats
    """Shape (n,)."""
    battery_current_a: Floats
    """Shape (n,); larger empties the battery sooner."""
    peers: list[list[PeerFix]]
    """Per vehicle: the fixes of peers that its radio tells this tick."""
    victims: list[list[VictimFix]]
    """Per vehicle: the victims it sees now."""
    home_ned_m: Floats
    """Shape (n, 3): where each one's local frame begins; it stays there."""
    drift_ned_m: Floats
    """Shape (n, 3): estimated position = truth - home + drift."""
    gnss_reception: NDArray[np.int8]
    """Shape (n,): `gnss.Reception`."""
    gnss_error_ned_m: Floats
    """Shape (n, 3): fix - truth; without odometry the estimate is as wrong."""
    scans_cm: NDArray[np.uint16] | None = None
    """`ring_m` as OBSTACLE_DISTANCE tells it; None until somebody does."""
    has_odometry: bool = False
    """Whether flow or vision tells the position where satellites do not."""

    @classmethod
    def blank(cls, n: int) -> Readings:
        """Build the readings of n vehicles that see nothing and are fully charged."""
        return cls(
            ranges_m=np.full((n, 6), np.inf),
            ring_m=np.full((n, 72), np.inf),
            range_max_m=10.0,
            range_min_m=0.2,
            battery_fraction=np.ones(n),
            battery_voltage_v=np.full(n, 16.2),  # PX4 SITL, reference/px4
            battery_current_a=np.zeros(n),
            peers=[[] for _ in range(n)],
            victims=[[] for _ in range(n)],
            home_ned_m=np.zeros((n, 3)),
            drift_ned_m=np.zeros((n, 3)),
            gnss_reception=np.full(n, Reception.PRESENT, dtype=np.int8),
            gnss_error_ned_m=np.zeros((n, 3)),
        )
