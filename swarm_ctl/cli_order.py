"""The command that orders vehicles in flight: `order`."""

from __future__ import annotations

import asyncio
import os
from typing import Annotated

import typer

from swarm_ctl.bus.messages import Ack
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.bus.orders import give
from swarm_ctl.cli_options import MQTT, check_name
from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Operator

NOT_OBEYED = 1


def order(
    what: Annotated[
        Operator,
        typer.Argument(metavar="ORDER", help=f"One of {', '.join(Operator)}.", show_default=False),
    ],
    mqtt: Annotated[str, MQTT],
    mission: Annotated[
        str, typer.Option(help="Name of the mission.", metavar="NAME", show_default=False)
    ],
    sysid: Annotated[
        int | None, typer.Option(help="The one vehicle to order; default: all of them.", min=1)
    ] = None,
    vehicles: Annotated[
        int | None,
        typer.Option(help="How many have to acknowledge an order to all; default: any.", min=1),
    ] = None,
    timeout: Annotated[
        float, typer.Option(help="Longest wait for acknowledgements, seconds.", min=0.1)
    ] = 5.0,
) -> None:
    """Order vehicles in flight over MQTT, and wait for their acknowledgements.

    Exit status: 0 obeyed, 1 not acknowledged or refused by somebody, 2 bad input or no broker.
    """
    broker = Broker.parse(mqtt, os.environ)
    check_name(mission)
    if sysid is not None and vehicles is not None:
        raise SwarmError("--vehicles counts those of an order to all; leave it or --sysid out")
    expected = 1 if sysid is not None else vehicles
    acks: dict[int, Ack] = {}

    def heard(sender: int, ack: Ack) -> bool:
        acks[sender] = ack
        word = "accepted" if ack.accepted else "refused"
        typer.echo(f"vehicle {sender}: {what} {word}, it is {ack.phase}")
        return len(acks) == expected

    try:
        asyncio.run(asyncio.wait_for(give(broker, mission, sysid, what, heard), timeout))
    except TimeoutError:
        if not acks or expected is not None:
            count = f"{len(acks)} of {expected}" if expected else "nobody"
            typer.echo(f"{count} acknowledged within {timeout:g} s", err=True)
            raise typer.Exit(NOT_OBEYED) from None
    raise typer.Exit(0 if all(ack.accepted for ack in acks.values()) else NOT_OBEYED)
