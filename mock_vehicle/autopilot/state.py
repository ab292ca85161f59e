"""What an autopilot knows of itself at a time."""

from __future__ import annotations

from typing import NamedTuple


class State(NamedTuple):
    """One vehicle's row of truth and readings, as of the last refresh; local NED, SI."""

    north_m: float
    east_m: float
    down_m: float
    """Estimated position: truth - home + its error."""
    north_m_s: float
    east_m_s: float
    down_m_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rad_s: float
    on_ground: float
    drift_north_m: float
    drift_east_m: float
    drift_down_m: float
    battery_fraction: float
    battery_voltage_v: float
    battery_current_a: float
    reception: float
    """`gnss.Reception`."""
    fix_error_north_m: float
    fix_error_east_m: float
    fix_error_down_m: float
    ranges_m: list[float]

    @property
    def true_position_m(self) -> tuple[float, float, float]:
        """Where it really is, in local NED."""
        return (
            self.north_m - self.drift_north_m,
            self.east_m - self.drift_east_m,
            self.down_m - self.drift_down_m,
        )

    @property
    def fix_m(self) -> tuple[float, float, float]:
        """Where the satellites say that it is, in local NED."""
        north, east, down = self.true_position_m
        return (
            north + self.fix_error_north_m,
            east + self.fix_error_east_m,
            down + self.fix_error_down_m,
        )
