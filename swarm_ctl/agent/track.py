"""Where one peer is and how it moves, by fixes, beacons and odometry: a Kalman filter in floats."""

from __future__ import annotations

import math

from swarm_ctl.agent.beacon import Beacon
from swarm_ctl.model import ZERO, Vec3

GATE = 16.3
"""Squared distance of what is believed, in variances: one of a thousand is refused (chi², 3)."""
AGREEING = 3
"""So many refused fixes in a row that agree are right, and the track is wrong."""
RIVAL_S, RIVAL_M_S = 0.7, 1.5
"""Two refused fixes agree within this time, and when they lie no farther apart than this speed."""
UNTOLD_M_S = 1.0
"""Standard deviation of a velocity that nobody has told, per axis."""
TOLD_M_S = 0.15
"""The same of one that is told: it is a tenth of a second late, or three, and rounded."""
MANOEUVRE_S = 0.5
"""A vehicle brakes or turns for so long at a time: makes process noise of an acceleration."""
MEASURED_S = 0.5
"""Only fixes this young contradict what a peer tells of its velocity."""
ODOMETRY_M, ODOMETRY_FRACTION = 0.02, 0.05
"""Error of a displacement that a peer tells: as such, and per distance (drift, and compasses)."""
JUMP_M, JUMP_M_S = 0.3, 1.0
"""A displacement this far from what both velocities lead to, and so much more for each second,
is none: the peer's own frame has moved."""
WORST_M2, WORST_M2_S2 = 400.0, 25.0
"""Variances grow no farther: by then the track is of no use anyway."""


class Track:
    """Position and velocity of a peer in the own local frame, as estimated at `at_s`.

    All three axes share one covariance of position and velocity (`pp`, `pv`, `vv`): what is
    measured is nearly as good along one as along another.
    """

    __slots__ = (
        "_anchor",
        "_q",
        "_rival",
        "_rival_s",
        "at_s",
        "fixed_s",
        "odds",
        "pp",
        "pv",
        "refused",
        "rivals",
        "vv",
        "vx",
        "vy",
        "vz",
        "x",
        "y",
        "z",
    )
    x: float
    y: float
    z: float
    """Place at `at_s`, north, east, down from the own origin."""
    vx: float
    vy: float
    vz: float
    pp: float
    pv: float
    vv: float
    at_s: float
    fixed_s: float
    """When the last fix was taken."""
    odds: int
    """Velocities told in a row that the fixes contradict."""
    refused: int
    """Fixes that were not believed."""
    rivals: int
    """Refused fixes in a row that agree with each other."""
    _rival: Vec3
    _rival_s: float
    _anchor: tuple[Vec3, float, Beacon, float] | None
    """Place, variance, beacon and time as of the last beacon; None when a fix came after it."""

    def __init__(
        self, place: Vec3, variance_m2: float, measured_s: float, acceleration_m_s2: float
    ) -> None:
        """Begin with a first fix; peers change their velocity by `acceleration_m_s2` at most."""
        self._q = acceleration_m_s2 * acceleration_m_s2 * MANOEUVRE_S / 3.0
        self.vx = self.vy = self.vz = 0.0
        self.refused = self.odds = 0
        self._restart(place, variance_m2, measured_s)

    def at(self, now: float) -> tuple[Vec3, Vec3, float]:
        """Give place, velocity, and the standard deviation of the place per axis."""
        dt = now - self.at_s
        vx, vy, vz = self.vx, self.vy, self.vz
        pp = self.pp + dt * (2.0 * self.pv + dt * (self.vv + self._q * dt / 3.0))
        place = Vec3(self.x + vx * dt, self.y + vy * dt, self.z + vz * dt)
        return place, Vec3(vx, vy, vz), math.sqrt(max(self.pp, min(pp, WORST_M2)))

    def rival_at(self, now: float) -> Vec3 | None:
        """Give where refused fixes that agree say the peer is; None without two in a row."""
        if self.rivals < 2 or now - self._rival_s > RIVAL_S:
            return None
        return self._moved(self._rival, now - self._rival_s)

    def fix(self, place: Vec3, variance_m2: float, measured_s: float, now: float) -> None:
        """Take a place that was measured a moment ago, unless it lies outside the gate."""
        self._advance(now)
        late = self.at_s - measured_s
        # innovation of z = p - late * v, with H = (1, -late); the same for every axis
        pp, pv = self.pp - late * self.pv, self.pv - late * self.vv
        total = pp - late * pv + variance_m2 + self._q * late * late * late / 3.0
        dx = place.x - self.x + late * self.vx
        dy = place.y - self.y + late * self.vy
        dz = place.z - self.z + late * self.vz
        if dx * dx + dy * dy + dz * dz > GATE * total:
            self._refuse(self._moved(place, late), variance_m2)
            return
        self._correct(dx, dy, dz, pp / total, pv / total)
        self.pp -= pp * pp / total
        self.pv -= pp * pv / total
        self.vv -= pv * pv / total
        self.fixed_s, self.rivals, self._anchor = self.at_s, 0, None

    def hear(self, beacon: Beacon, now: float) -> None:
        """Take what the peer tells: its velocity, and how far it came since the last beacon."""
        self._advance(now)
        if self._anchor is not None:
            self._carry(beacon, *self._anchor)
        told, total = beacon.velocity_ned_m_s, self.vv + TOLD_M_S * TOLD_M_S
        dx, dy, dz = told.x - self.vx, told.y - self.vy, told.z - self.vz
        if dx * dx + dy * dy + dz * dz > GATE * total and self.at_s - self.fixed_s < MEASURED_S:
            self.odds += 1
            return
        self.odds = 0
        self._correct(dx, dy, dz, self.pv / total, self.vv / total)
        self.pp -= self.pv * self.pv / total
        self.pv -= self.pv * self.vv / total
        self.vv -= self.vv * self.vv / total
        self._anchor = Vec3(self.x, self.y, self.z), self.pp, beacon, self.at_s

    def _advance(self, now: float) -> None:
        """Predict, with white noise of acceleration; time that runs backwards stands still."""
        dt = now - self.at_s
        if dt <= 0.0:
            return
        q, vv = self._q * dt, self.vv
        self.x, self.y, self.z = self.x + self.vx * dt, self.y + self.vy * dt, self.z + self.vz * dt
        self.pp = min(self.pp + dt * (2.0 * self.pv + dt * (vv + q / 3.0)), WORST_M2)
        self.pv = min(self.pv + dt * (vv + q / 2.0), math.sqrt(self.pp * vv))
        self.vv = min(vv + q, WORST_M2_S2)
        self.at_s = now

    def _correct(
        self, dx: float, dy: float, dz: float, place_gain: float, velocity_gain: float
    ) -> None:
        self.x, self.y, self.z = (
            self.x + place_gain * dx,
            self.y + place_gain * dy,
            self.z + place_gain * dz,
        )
        self.vx += velocity_gain * dx
        self.vy += velocity_gain * dy
        self.vz += velocity_gain * dz

    def _carry(self, beacon: Beacon, place: Vec3, pp: float, before: Beacon, at_s: float) -> None:
        """Move on by the peer's own odometry, when no fix came between two of its beacons."""
        dt = self.at_s - at_s
        there, here = beacon.position_ned_m, before.position_ned_m
        dx, dy, dz = there.x - here.x, there.y - here.y, there.z - here.z
        one, other = before.velocity_ned_m_s, beacon.velocity_ned_m_s
        half = 0.5 * dt
        off_m = math.hypot(
            dx - half * (one.x + other.x),
            dy - half * (one.y + other.y),
            dz - half * (one.z + other.z),
        )
        if off_m > JUMP_M + JUMP_M_S * dt:
            return
        error_m = ODOMETRY_M + ODOMETRY_FRACTION * math.hypot(dx, dy, dz)
        self.x, self.y, self.z = place.x + dx, place.y + dy, place.z + dz
        self.pp, self.pv = min(self.pp, pp + error_m * error_m), 0.0

    def _refuse(self, place: Vec3, variance_m2: float) -> None:
        """Leave a fix out; one more that agrees with those before starts the track anew."""
        self.refused += 1
        now, apart_s = self.at_s, self.at_s - self._rival_s
        reach_m = RIVAL_M_S * apart_s
        close_m2 = 2.0 * GATE * variance_m2 + reach_m * reach_m
        dx, dy, dz = place.x - self._rival.x, place.y - self._rival.y, place.z - self._rival.z
        agrees = apart_s <= RIVAL_S and dx * dx + dy * dy + dz * dz <= close_m2
        self.rivals = self.rivals + 1 if agrees else 1
        self._rival, self._rival_s = place, now
        if self.rivals >= AGREEING:
            self._restart(place, variance_m2, now)

    def _restart(self, place: Vec3, variance_m2: float, when: float) -> None:
        self.x, self.y, self.z = place
        self.pp, self.pv, self.vv = min(variance_m2, WORST_M2), 0.0, UNTOLD_M_S * UNTOLD_M_S
        self.at_s = self.fixed_s = when
        self.rivals, self._rival, self._rival_s = 0, ZERO, -math.inf
        self._anchor = None

    def _moved(self, place: Vec3, age_s: float) -> Vec3:
        return Vec3(place.x + self.vx * age_s, place.y + self.vy * age_s, place.z + self.vz * age_s)
