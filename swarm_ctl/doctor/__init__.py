"""What would bite in the air, found on the ground: examine autopilots before they fly."""
