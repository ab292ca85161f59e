"""A four-cell battery per vehicle, drained by momentum theory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FLOATS = NDArray[np.float64]

MASS_KG = 1.5
GRAVITY_M_S2 = 9.80665
AIR_KG_M3 = 1.225
ROTORS = 4
ROTOR_RADIUS_M = 0.127
"""A 10-inch propeller."""
EFFICIENCY = 0.45
"""Figure of merit (about 0.65) times motor and controller (about 0.7)."""
DRAG_AREA_M2 = 0.05
"""Drag coefficient times frontal area of a 450 mm quadrotor."""

CELLS = 4
CAPACITY_AH = 5.0
RESISTANCE_OHM = 0.03
AVIONICS_W = 6.0
IDLE_W = 12.0
"""Spinning, standing."""
CELL_CHARGE = (0.0, 0.05, 0.1, 0.2, 0.5, 0.8, 1.0)
CELL_VOLTAGE_V = (3.0, 3.45, 3.6, 3.7, 3.82, 4.02, 4.2)
"""Open-circuit voltage of a lithium-polymer cell over its charge."""
FULL_V = CELLS * CELL_VOLTAGE_V[-1]


def hover_power_w() -> float:
    """Electric power to hover: (m g)^1.5 / sqrt(2 rho A) / efficiency (momentum theory)."""
    disc_m2 = ROTORS * np.pi * ROTOR_RADIUS_M**2
    induced = (MASS_KG * GRAVITY_M_S2) ** 1.5 / np.sqrt(2.0 * AIR_KG_M3 * disc_m2)
    return float(induced / EFFICIENCY)


HOVER_W = hover_power_w()


class Batteries:
    """The batteries of a whole fleet."""

    def __init__(self, n: int) -> None:
        self.fraction = np.ones(n)
        """Charge left, 0..1."""
        self.voltage_v = np.full(n, FULL_V)
        self.current_a = np.zeros(n)
        self.extra_w = np.zeros(n)
        """Drawn by something that should not."""
        self.energy_j = np.zeros(n)
        """Drawn since the start."""

    def step(
        self,
        dt: float,
        velocity_ned_m_s: FLOATS,
        *,
        airborne: NDArray[np.bool_],
        powered: NDArray[np.bool_],
        spinning: NDArray[np.bool_],
    ) -> None:
        """Drain for `dt`: hover, parasite drag (v cubed) and climb; descent gives nothing back."""
        speed = np.sqrt(np.einsum("ij,ij->i", velocity_ned_m_s, velocity_ned_m_s))
        drag = 0.5 * AIR_KG_M3 * DRAG_AREA_M2 * speed**3 / EFFICIENCY
        climb = MASS_KG * GRAVITY_M_S2 / EFFICIENCY * np.maximum(-velocity_ned_m_s[:, 2], 0.0)
        flying = np.where(airborne, HOVER_W + drag + climb, IDLE_W)
        power = np.where(spinning, flying, 0.0) + AVIONICS_W + self.extra_w
        power = np.where(powered & (self.fraction > 0.0), power, 0.0)
        rest = CELLS * np.interp(self.fraction, CELL_CHARGE, CELL_VOLTAGE_V)
        self.current_a = power / self.voltage_v
        self.voltage_v = rest - RESISTANCE_OHM * self.current_a
        self.fraction = np.maximum(self.fraction - self.current_a * dt / (3600 * CAPACITY_AH), 0.0)
        self.energy_j += power * dt

    def discharge_to(self, index: int, fraction: float) -> None:
        """Lose charge at once, never gain any."""
        self.fraction[index] = min(self.fraction[index], fraction)
