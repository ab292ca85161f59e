"""Fly with DroneKit, as an application would."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import hypot
from typing import Any

from clients.scenario import main, until
from dronekit import Command, LocationGlobalRelative, VehicleMode, connect

HEIGHT_M = 3.0
NORTH_DEG = 1e-4
"""About 11 m."""
ARDUPILOT = 3
"""MAV_AUTOPILOT."""
FRAME_RELATIVE, NAV_WAYPOINT, NAV_TAKEOFF = 3, 16, 22


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Be connected, with parameters, GPS, mode and attitude there."""
    vehicle = connect(address, wait_ready=True, timeout=30, heartbeat_timeout=15)
    try:
        yield vehicle
    finally:
        vehicle.close()


def height_m(vehicle: Any) -> float:
    """Tell the height above home."""
    return float(vehicle.location.global_relative_frame.alt)


def download(vehicle: Any) -> Any:
    """Read the mission that the vehicle has."""
    vehicle.commands.download()
    vehicle.commands.wait_ready(timeout=10)
    return vehicle.commands


def take_off(vehicle: Any) -> None:
    """Arm in GUIDED and begin to climb."""
    vehicle.wait_for_armable(timeout=10)
    vehicle.wait_for_mode("GUIDED", timeout=10)
    vehicle.arm(timeout=10)
    vehicle.simple_takeoff(HEIGHT_M)


def be_up(vehicle: Any) -> None:
    """Wait for the end of the climb."""
    until(lambda: height_m(vehicle) > HEIGHT_M - 0.3, "at the take-off height")


def be_down(vehicle: Any) -> None:
    """Wait for the end of a flight."""
    until(lambda: not vehicle.armed, "disarmed")


def attributes(address: str) -> dict[str, Any]:
    """Look at the vehicle."""
    with connected(address) as vehicle:
        until(lambda: vehicle.version.major is not None, "of a known version")
        if vehicle.version.autopilot_type == ARDUPILOT:
            download(vehicle)  # it tells home with the mission, PX4 every other second
        until(lambda: vehicle.home_location is not None, "at home")
        until(lambda: vehicle.location.local_frame.down is not None, "somewhere")
        return {
            "version": str(vehicle.version),
            "mode": vehicle.mode.name,
            "armed": vehicle.armed,
            "fix": vehicle.gps_0.fix_type,
            "satellites": vehicle.gps_0.satellites_visible,
            "ekf_ok": vehicle.ekf_ok,
            "battery_v": vehicle.battery.voltage,
            "state": vehicle.system_status.state,
            "parameters": len(vehicle.parameters),
            "home_deg": [vehicle.home_location.lat, vehicle.home_location.lon],
        }


def flight(address: str) -> dict[str, Any]:
    """Take off, go somewhere, return and land."""
    with connected(address) as vehicle:
        take_off(vehicle)
        be_up(vehicle)
        home = vehicle.location.global_relative_frame
        vehicle.simple_goto(LocationGlobalRelative(home.lat + NORTH_DEG, home.lon, HEIGHT_M))
        until(lambda: vehicle.location.local_frame.north > 10.0, "in the north")
        farthest_m = vehicle.location.local_frame.north
        vehicle.wait_for_mode("RTL", timeout=10)
        be_down(vehicle)
        place = vehicle.location.local_frame
        return {"farthest_m": farthest_m, "from_home_m": hypot(place.north, place.east)}


def parameters(address: str, name: str, value: str) -> dict[str, Any]:
    """Set a parameter, and see the vehicle agree."""
    with connected(address) as vehicle:
        heard: list[float] = []
        vehicle.parameters.add_attribute_listener(name, lambda *seen: heard.append(seen[-1]))
        before = vehicle.parameters[name]
        vehicle.parameters.set(name, float(value), wait_ready=True)
        until(lambda: heard, "echoed")
        return {"before": before, "after": vehicle.parameters[name], "heard": heard}


def mission(address: str) -> dict[str, Any]:
    """Upload a mission, read it back and fly it."""
    with connected(address) as vehicle:
        commands = download(vehicle)
        commands.clear()
        place = vehicle.location.global_frame
        for command, north_deg in ((NAV_TAKEOFF, 0.0), (NAV_WAYPOINT, NORTH_DEG)):
            where = (place.lat + north_deg, place.lon, HEIGHT_M)
            commands.add(Command(0, 0, 0, FRAME_RELATIVE, command, 0, 1, 0, 0, 0, 0, *where))
        commands.upload(timeout=10)
        kept = [item.command for item in download(vehicle)]
        take_off(vehicle)
        be_up(vehicle)
        vehicle.wait_for_mode("AUTO", timeout=10)
        until(lambda: vehicle.location.local_frame.north > 10.0, "in the north")
        vehicle.wait_for_mode("LAND", timeout=10)
        be_down(vehicle)
        return {"kept": kept, "next": commands.next}


def fleet(*addresses: str) -> dict[str, Any]:
    """Fly several vehicles at once."""
    with ExitStack() as stack:
        vehicles = [stack.enter_context(connected(address)) for address in addresses]
        for vehicle in vehicles:
            take_off(vehicle)
        for vehicle in vehicles:
            be_up(vehicle)
        heights_m = [height_m(vehicle) for vehicle in vehicles]
        for vehicle in vehicles:
            vehicle.mode = VehicleMode("LAND")
        for vehicle in vehicles:
            be_down(vehicle)
        return {"heights_m": heights_m, "armed": [vehicle.armed for vehicle in vehicles]}


SCENARIOS = (attributes, flight, parameters, mission, fleet)

if __name__ == "__main__":
    main({scenario.__name__: scenario for scenario in SCENARIOS})
