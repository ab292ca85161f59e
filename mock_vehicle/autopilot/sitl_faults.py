"""ArduPilot's simulator breaks things by parameters, SIM_*; so does the mock."""

from __future__ import annotations

from mock_vehicle.autopilot.parameters import Parameters

LIMPS = 0.5
"""A motor with a smaller share of its thrust than this (SIM_ENGINE_MUL) cannot hold the vehicle."""


def ordered(parameters: Parameters) -> frozenset[str]:
    """Name the kinds of faults that the parameters ask for."""
    finite = parameters.finite
    asked = {
        "gnss-loss": finite("SIM_GPS1_ENABLE") == 0.0,
        "motor": finite("SIM_ENGINE_FAIL") != 0.0 and finite("SIM_ENGINE_MUL") < LIMPS,
    }
    return frozenset(kind for kind, is_asked in asked.items() if is_asked)
