"""Datagrams and bytes between a controller and its autopilot."""
