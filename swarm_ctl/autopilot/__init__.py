"""Intents to MAVLink and MAVLink to telemetry, one module per autopilot."""
