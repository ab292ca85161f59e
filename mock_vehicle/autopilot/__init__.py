"""How PX4 and ArduPilot answer on the wire."""
