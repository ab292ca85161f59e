"""A fleet of mock MAVLink vehicles on UDP: an independent witness for controllers and tests."""
