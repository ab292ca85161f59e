"""From what a test asks for to vehicles that fly."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from datetime import UTC, datetime

from mock_vehicle.ports import LOCALHOST, free_udp_port
from mock_vehicle.server import Port, Server
from mock_vehicle.testing.plan import Plan
from mock_vehicle.testing.real import Pilot, RealSwarm, RealVehicle
from mock_vehicle.testing.virtual import VirtualSwarm, VirtualVehicle, Wires
from mock_vehicle.testing.watched import WatchedFleet
from swarm_ctl.signing import EPOCH, key_of, timestamp_of


@contextlib.contextmanager
def launch(plan: Plan) -> Iterator[RealSwarm | VirtualSwarm]:
    """Fly what is planned, as long as the context lasts.

    WorldError names file and key of a world that cannot be, ValueError a fault that cannot.
    """
    fleet = WatchedFleet(plan.load_world(), plan.kinds, **plan.fleet_arguments())
    if plan.signing_key is not None:
        begin = EPOCH if plan.time == "virtual" else datetime.now(UTC)
        fleet.sign_with(key_of(str(plan.signing_key)), timestamp_of(begin))
    if plan.time == "virtual":
        wires = Wires(fleet)
        yield VirtualSwarm(wires, [VirtualVehicle(wires, index) for index in range(fleet.n)])
        return
    ports = _called_ports(fleet, one_port=plan.one_port)
    server = Server(fleet, [Port((LOCALHOST, 0), (LOCALHOST, p)) for p in ports], speed=plan.speed)
    called = dict(zip(fleet.places, ports, strict=True))
    pilot = Pilot(fleet, server)
    try:
        yield RealSwarm(pilot, _vehicles(pilot, server, called))
    finally:
        pilot.close()


def _called_ports(fleet: WatchedFleet, *, one_port: bool) -> list[int]:
    """Find a free port per place; with `one_port` one for each kind of link."""
    links = {link: free_udp_port() for _, link in fleet.places}
    return [links[link] if one_port else free_udp_port() for _, link in fleet.places]


def _vehicles(
    pilot: Pilot, server: Server, called: dict[tuple[int, int], int]
) -> list[RealVehicle]:
    return [
        RealVehicle(
            pilot,
            index,
            port=called[index, 0],
            gcs_port=called.get((index, 1), called[index, 0]),
            bind=bind,
        )
        for index, bind in enumerate(server.ports)
    ]
