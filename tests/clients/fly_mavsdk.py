"""Fly with MAVSDK, as an application would."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from json import dumps
from math import cos, degrees, dist, isfinite, radians
from typing import Any

from clients.scenario import main, until
from mavsdk import ComponentType, Configuration, Mavsdk, System
from mavsdk.plugins.action import Action
from mavsdk.plugins.info import Info, InfoError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.offboard import Offboard, PositionNedYaw, VelocityNedYaw
from mavsdk.plugins.param import Param, ParamError
from mavsdk.plugins.telemetry import Telemetry

HEIGHT_M = 3.0
NORTH_M = 2.0
RETURN_HEIGHT_M = 6.0
CORNER_NED_M = (6.0, 4.0, -5.0)
LEGS_M = ((0.0, 0.0, 4.0), (8.0, 0.0, 4.0), (8.0, 6.0, 5.0))
"""North, east, height; ArduPilot keeps its home in place of the first."""
SET_MESSAGE_INTERVAL, MISSION_CURRENT = 511, 42
EARTH_M = 6_378_137.0


@contextmanager
def listening(port: str) -> Iterator[Mavsdk]:
    """Be a ground station that vehicles call."""
    station = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    station.add_any_connection(f"udpin://127.0.0.1:{port}")
    try:
        yield station
    finally:
        station.destroy()


class Pilot:
    """One vehicle and the plugins to fly it with."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.action = Action(system)
        self.offboard = Offboard(system)
        self.telemetry = Telemetry(system)
        self.modes: list[str] = []
        self.telemetry.subscribe_flight_mode(self._note_mode)

    def _note_mode(self, mode: Any, _: object) -> None:
        if self.modes[-1:] != [mode.name]:
            self.modes.append(mode.name)

    def become_healthy(self) -> None:
        """Ask for what ArduPilot does not send unasked, and wait for everything to be well."""
        for name in ("health", "position", "landed_state", "position_velocity_ned", "raw_gps"):
            getattr(self.telemetry, f"set_rate_{name}")(10.0)
        self._ask_for_mission_progress()
        until(self.telemetry.health_all_ok, "healthy")
        until(lambda: isfinite(self.telemetry.position().latitude_deg), "on the globe")

    def _ask_for_mission_progress(self) -> None:
        """Let MISSION_CURRENT flow, which has no rate of its own in the plugins."""
        request = {
            "command": SET_MESSAGE_INTERVAL,
            "target_system": self.system.get_system_id(),
            "target_component": 1,
            "param1": MISSION_CURRENT,
            "param2": 2e5,
        }
        message = MavlinkMessage("COMMAND_LONG", 245, 190, fields_json=dumps(request))
        MavlinkDirect(self.system).send_message(message)

    def place_ned_m(self) -> tuple[float, float, float]:
        """Tell where the vehicle says it is."""
        place = self.telemetry.position_velocity_ned().position
        return (place.north_m, place.east_m, place.down_m)

    def take_off(self) -> None:
        """Arm and begin to climb."""
        self.action.set_takeoff_altitude(HEIGHT_M)
        self.action.arm()
        self.action.takeoff()

    def be_up(self) -> None:
        """Wait for the end of the climb."""
        until(lambda: self.place_ned_m()[2] < 0.5 - HEIGHT_M, "at the take-off height")

    def go_north(self) -> None:
        """Begin to fly by velocity."""
        self.offboard.set_velocity_ned(VelocityNedYaw(1.5, 0.0, 0.0, 0.0))
        self.offboard.start()

    def be_north(self) -> None:
        """Wait for the velocity to show."""
        until(lambda: self.place_ned_m()[0] > NORTH_M, "north of the start")

    def go_to_corner(self) -> None:
        """Fly by position."""
        self.offboard.set_position_ned(PositionNedYaw(*CORNER_NED_M, 0.0))
        until(lambda: dist(self.place_ned_m(), CORNER_NED_M) < 0.5, "at the corner")

    def be_down(self) -> None:
        """Wait for the end of a flight."""
        until(lambda: not self.telemetry.armed(), "disarmed")
        until(lambda: self.telemetry.landed_state().name == "ON_GROUND", "on the ground")


def meet(station: Mavsdk, vehicles: int = 1) -> list[Pilot]:
    """Wait for vehicles and their heartbeats: until then MAVSDK takes them for no PX4."""
    until(lambda: len(_known(station)) == vehicles, "complete")
    return [Pilot(system) for system in _known(station)]


def _known(station: Mavsdk) -> list[System]:
    return [system for system in station.get_systems() if system.is_connected()]


def flight(port: str) -> dict[str, Any]:
    """Arm, take off, fly by velocity and position, return, land and disarm."""
    with listening(port) as station:
        (pilot,) = meet(station)
        pilot.become_healthy()
        pilot.action.set_return_to_launch_altitude(RETURN_HEIGHT_M)
        pilot.take_off()
        pilot.be_up()
        in_air = pilot.telemetry.in_air()
        pilot.go_north()
        pilot.be_north()
        pilot.go_to_corner()
        was_active = pilot.offboard.is_active()
        pilot.offboard.stop()
        pilot.action.return_to_launch()
        pilot.be_down()
        return {
            "sysid": pilot.system.get_system_id(),
            "in_air": in_air,
            "offboard": was_active,
            "modes": pilot.modes,
            "from_home_m": dist(pilot.place_ned_m()[:2], (0.0, 0.0)),
        }


def parameters(port: str, integer: str, real: str) -> dict[str, Any]:
    """Read all parameters, set one of either kind, and ask for one that is not there."""
    with listening(port) as station:
        (pilot,) = meet(station)
        param = Param(pilot.system)
        began_s = time.monotonic()
        everything = param.get_all_params()
        took_s = time.monotonic() - began_s
        param.set_param_int(integer, 2)
        param.set_param_float(real, 7.25)
        try:
            unknown = str(param.get_param_int("NO_SUCH_PARAM"))
        except ParamError as error:
            unknown = error.result.name
        return {
            "count": len(everything.int_params) + len(everything.float_params),
            "took_s": took_s,
            "integer": param.get_param_int(integer),
            "real": param.get_param_float(real),
            "unknown": unknown,
        }


def mission(port: str) -> dict[str, Any]:
    """Upload a mission, read it back, fly it, land and clear it."""
    with listening(port) as station:
        (pilot,) = meet(station)
        pilot.become_healthy()
        home = pilot.telemetry.position()
        plan = MissionPlan([waypoint(home, *leg) for leg in LEGS_M])
        service = Mission(pilot.system)
        service.upload_mission(plan)
        kept = MissionRaw(pilot.system).download_mission()  # the plain one refuses a home item
        pilot.take_off()
        pilot.be_up()
        service.start_mission()
        reached: list[int] = []
        service.subscribe_mission_progress(lambda progress, _: reached.append(progress.current))
        until(service.is_mission_finished, "finished")
        end_ned_m = pilot.place_ned_m()
        pilot.action.land()
        pilot.be_down()
        service.clear_mission()
        return {
            "kept_deg": [[item.x / 1e7, item.y / 1e7] for item in kept],
            "sent_deg": [[item.latitude_deg, item.longitude_deg] for item in plan.mission_items],
            "reached": sorted(set(reached)),
            "from_end_m": dist(end_ned_m, (*LEGS_M[-1][:2], -LEGS_M[-1][2])),
            "modes": pilot.modes,
        }


def plan(port: str, file: str) -> dict[str, Any]:
    """Read a plan of QGroundControl, upload it and read it back."""
    with listening(port) as station:
        system = station.first_autopilot(20.0)
        assert system is not None, "no vehicle called"
        service = MissionRaw(system)
        items = service.import_qgroundcontrol_mission(file).mission_items
        service.upload_mission(items)
        kept = service.download_mission()
        return {"commands": [[item.command for item in one] for one in (items, kept)]}


def waypoint(home: Any, north_m: float, east_m: float, height_m: float) -> MissionItem:
    """Make an item at an offset from home."""
    east_deg = degrees(east_m / EARTH_M / cos(radians(home.latitude_deg)))
    return MissionItem(
        latitude_deg=home.latitude_deg + degrees(north_m / EARTH_M),
        longitude_deg=home.longitude_deg + east_deg,
        relative_altitude_m=height_m,
        is_fly_through=True,
        acceptance_radius_m=1.0,
    )


def introduction(port: str) -> dict[str, Any]:
    """Ask a vehicle who it is, arm it and disarm it on the ground."""
    with listening(port) as station:
        (pilot,) = meet(station)
        pilot.become_healthy()
        info = Info(pilot.system)
        version = info.get_version()
        pilot.action.arm()
        until(pilot.telemetry.armed, "armed")
        pilot.action.disarm()
        until(lambda: not pilot.telemetry.armed(), "disarmed")
        return {
            "autopilot": pilot.system.autopilot_type().name,
            "vehicle": pilot.system.vehicle_type().name,
            "version": [version.flight_sw_major, version.flight_sw_minor],
            "uid": info.get_identification().hardware_uid,
        }


def fleet(port: str, vehicles: str) -> dict[str, Any]:
    """Fly several vehicles at once: everybody does one step before the next begins."""
    with listening(port) as station:
        pilots = meet(station, int(vehicles))
        steps: tuple[Callable[[Pilot], None], ...] = (
            Pilot.become_healthy,
            Pilot.take_off,
            Pilot.be_up,
            Pilot.go_north,
            Pilot.be_north,
            lambda pilot: pilot.offboard.stop(),
            lambda pilot: pilot.action.land(),
            Pilot.be_down,
        )
        for step in steps:
            for pilot in pilots:
                step(pilot)
        return {"north_m": {p.system.get_system_id(): p.place_ned_m()[0] for p in pilots}}


def discovery(port: str, vehicles: str) -> dict[str, Any]:
    """Count who calls, and how long it takes to know them all by their ids."""
    began_s = time.monotonic()
    with listening(port) as station:
        systems = [pilot.system for pilot in meet(station, int(vehicles))]
        found_s = time.monotonic() - began_s
        until(lambda: all(_uid(system) for system in systems), "known", 10.0)
        return {
            "found_s": found_s,
            "known_s": time.monotonic() - began_s,
            "sysids": sorted(system.get_system_id() for system in systems),
            "uids": [_uid(system) for system in systems],
        }


def _uid(system: System) -> str:
    try:
        return str(Info(system).get_identification().hardware_uid)
    except InfoError:
        return ""


SCENARIOS = (introduction, flight, parameters, mission, plan, fleet, discovery)

if __name__ == "__main__":
    main({scenario.__name__: scenario for scenario in SCENARIOS})
