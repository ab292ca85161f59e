"""Mock vehicles inside a test's own process, in real time on UDP or in virtual time without it."""

from mock_vehicle.testing.launch import launch
from mock_vehicle.testing.plan import Plan
from mock_vehicle.testing.real import RealSwarm, RealVehicle
from mock_vehicle.testing.truth import Truth
from mock_vehicle.testing.vehicle import MockVehicle
from mock_vehicle.testing.virtual import VirtualSwarm, VirtualVehicle
from mock_vehicle.testing.watched import Message

__all__ = [
    "Message",
    "MockVehicle",
    "Plan",
    "RealSwarm",
    "RealVehicle",
    "Truth",
    "VirtualSwarm",
    "VirtualVehicle",
    "launch",
]
