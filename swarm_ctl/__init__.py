"""Explore unknown space with a swarm of UAVs: one ground-agnostic controller per vehicle."""

__version__ = "0.1.0"
