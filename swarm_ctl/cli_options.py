"""What the commands that fly have in common: options, the key, Ctrl-C."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from swarm_ctl.bus.embedded import embedded_broker, embedded_port
from swarm_ctl.bus.mqtt import PASSWORD_VARIABLE, Broker
from swarm_ctl.bus.peers import PeersOverMqtt
from swarm_ctl.errors import SwarmError
from swarm_ctl.link.broadcast import Broadcast
from swarm_ctl.link.mesh import Mesh
from swarm_ctl.link.url import Meeting, Network, parse_peers, spread
from swarm_ctl.mission import Mission
from swarm_ctl.model import Operator
from swarm_ctl.run.fleet import STOP_SIGNALS, TWICE
from swarm_ctl.signing import KEY_VARIABLE, find_key

if TYPE_CHECKING:
    from swarm_ctl.experiment.arena import Arena

INTERRUPTED, BAD_INPUT, NOT_FLOWN = 130, 2, 1
EXIT_CODES = {"flown": 0, "interrupted": INTERRUPTED, "failed": NOT_FLOWN}
"""Exit status by the outcome of a flight."""

MissionFile = Annotated[Path, typer.Argument(help="Mission file (YAML).", show_default=False)]
World = Annotated[
    Path | None, typer.Option(help="Fly in this world file instead of the mission's own.")
]
Vehicles = Annotated[int | None, typer.Option(help="Number of vehicles, 1 to 250.")]
PlannerKind = Annotated[
    str | None,
    typer.Option(help="Planner: explore, lf-pso, levy, pso, or your own as module:Class."),
]
AutopilotKind = Annotated[
    str | None, typer.Option(help="What the mock vehicles behave like: px4, ardupilot or mixed.")
]
Seed = Annotated[
    int | None, typer.Option(help="Seed of every random draw; repeats a --virtual run exactly.")
]
Duration = Annotated[float | None, typer.Option(help="Exploration time of each vehicle, seconds.")]


Connect = Annotated[
    list[str],
    typer.Option(
        help="Where an autopilot is: udpin://0.0.0.0:14540, udpout://HOST:PORT, "
        "tcpout://HOST:PORT or serial:///dev/ttyACM0:57600; again for more vehicles, or a range "
        "of ports, as udpout://HOST:14580-14589.",
        callback=spread,
        metavar="URL",
        show_default=False,
    ),
]
Out = Annotated[Path | None, typer.Option(help="Run folder; default runs/<mission>-<utc>.")]
SigningKey = Annotated[
    Path | None,
    typer.Option(
        help="Sign all that is sent with the key in this file: a passphrase or 64 hexadecimal "
        f"digits; default: the key in {KEY_VARIABLE}, if any.",
        metavar="FILE",
    ),
]

MQTT = typer.Option(
    "--mqtt",
    help="Broker that the vehicles hear: mqtt://[USER@]HOST[:PORT], or "
    f"mqtts:// for TLS; its password is in {PASSWORD_VARIABLE}.",
    metavar="URL",
    show_default=False,
)
Mqtt = Annotated[
    str | None,
    typer.Option(
        help="Broker to tell of the vehicles, and for orders: mqtt://[USER@]HOST[:PORT], or "
        f"mqtts:// for TLS, with its password in {PASSWORD_VARIABLE}; or embedded[:PORT] for one "
        "in this process, which serves this computer alone.",
        metavar="URL",
        show_default=False,
    ),
]
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
Wait = Annotated[
    bool,
    typer.Option(
        "--wait",
        help="Let the vehicles stand ready until `start` is ordered, over MQTT or by a ground "
        "station's MISSION_START.",
    ),
]


Peers = Annotated[
    str | None,
    typer.Option(
        help="What carries peers' frames beside the vehicles' radios: udp://239.255.42.42:14700 "
        "(multicast; ?interface=IP behind it chooses a network), udp://192.168.1.255:14700 "
        "(broadcast), mqtt://[USER@]HOST[:PORT], or autopilot for nothing else. Default: the "
        "mission's.",
        metavar="URL",
        show_default=False,
    ),
]


class PipeConsole(Console):
    """Prints on while somebody reads; the work does not depend on it."""

    def on_broken_pipe(self) -> None:
        """Say no more."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def read_key(file: Path | None) -> bytes | None:
    """Take the key from a file or the environment; what is wrong with it is one sentence."""
    try:
        return find_key(file, os.environ)
    except ValueError as error:
        raise SwarmError(str(error)) from None


def check_name(mission: str) -> None:
    """Refuse what can be no mission's name, and would be several topics of the bus."""
    if not _NAME.fullmatch(mission):
        raise SwarmError(f"--mission {mission}: expected the name of a mission, as usar_office")


@contextmanager
def open_broker(url: str | None) -> Iterator[Broker | None]:
    """Say where the broker is, if there is one; an embedded one runs until the block ends.

    What is wrong with it is one sentence.
    """
    if url is None:
        yield None
    elif (port := embedded_port(url)) is None:
        yield Broker.parse(url, os.environ)
    else:
        with embedded_broker(port) as broker:
            yield broker


@contextmanager
def open_mesh(mission: Mission) -> Iterator[Mesh | None]:
    """Open what carries peers' frames, if anything does; SwarmError when it cannot be had."""
    match parse_peers(mission.peers):
        case None:
            yield None
        case Network() as network:
            with closing(Mesh(Broadcast(network))) as mesh:
                yield mesh
        case Meeting(url):
            broker = Broker.parse(url, os.environ, "--peers")
            yield Mesh(PeersOverMqtt(broker, mission.name))


class Interrupts:
    """Ctrl-C and SIGTERM as an order to land; the second ends at once, a third even the record."""

    def __init__(self) -> None:
        self.count = 0
        self._obeyed = 0

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """Count one more."""
        self.count += 1
        if self.count > 2:
            raise KeyboardInterrupt

    def obey(self, arena: Arena) -> None:
        """Pass on to a flight what was asked for since the last call."""
        if self.count > self._obeyed and not self._obeyed:
            arena.order(Operator.LAND)
        if self.count > 1 and self._obeyed < 2 and not arena.is_over:
            arena.notes.append(TWICE)
            for controller in arena.controllers:
                controller.kill(TWICE, arena.now)
        self._obeyed = self.count


@contextmanager
def interrupts() -> Iterator[Interrupts]:
    """Count Ctrl-C and SIGTERM while this is open."""
    counted = Interrupts()
    before = {number: signal.signal(number, counted) for number in STOP_SIGNALS}
    try:
        yield counted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
