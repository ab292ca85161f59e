"""Real autopilots in their own simulators: started on loopback, each in a folder of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

ARDUCOPTER, PX4 = "SWARM_SITL_ARDUCOPTER", "SWARM_SITL_PX4"
START_S = STOP_S = 10.0
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 51.0, 7.0, 100.0
FIRST_SYSID, FIRST_INSTANCE = 20, 40
"""Of the ArduCopters: far from what somebody may have running by hand."""

COPTER = {
    "FRAME_CLASS": 1,  # quad
    "FRAME_TYPE": 0,  # plus, as `--model +`
    "BATT_MONITOR": 4,
    "BATT_CAPACITY": 100_000,  # a session of many flights empties no battery
    "RTL_ALT": 400,
    "RTL_ALT_M": 4,  # its name from 4.7 on
    **{f"INS_ACC{unit}OFFS_{axis}": 0.001 for unit in ("", 2) for axis in "XYZ"},
    **{f"INS_ACC{unit}SCAL_{axis}": 1.001 for unit in ("", 2) for axis in "XYZ"},
}
"""What a simulated ArduCopter must be told to be armed: that it has a frame and is calibrated."""


@dataclass(frozen=True)
class Simulator:
    """One simulated vehicle and the two ways to it."""

    autopilot: str
    sysid: int
    url: str
    """Where it calls its companion."""
    station: socket.socket
    """Its other link, for a ground station or a radio."""
    process: subprocess.Popen[bytes]
    log: Path


Starter = Callable[[int, Path, Mapping[str, float]], Simulator]


def arducopter(index: int, folder: Path, extra: Mapping[str, float]) -> Simulator:
    """Start one; it ends by itself when its parent does."""
    binary = _path(ARDUCOPTER)
    defaults = folder / "defaults.parm"
    values = COPTER | dict(extra)
    defaults.write_text("".join(f"{name} {value}\n" for name, value in values.items()))
    station = _listener()
    ports = {"companion": _free_port(), "station": station.getsockname()[1], "rc": _free_port()}
    sysid = FIRST_SYSID + index
    words = [
        *(binary, "--model", "+", "--speedup", 1, f"-I{FIRST_INSTANCE + index}", "--sysid", sysid),
        *("--home", f"{LATITUDE_DEG},{LONGITUDE_DEG},{ALTITUDE_M},0", "--defaults", defaults),
        *("--serial0", f"udpclient:127.0.0.1:{ports['companion']}"),
        *("--serial1", f"udpclient:127.0.0.1:{ports['station']}", "--serial2", "none:0"),
        *("--rc-in-port", ports["rc"], "-w"),
    ]
    process, log = _start(words, folder)
    url = f"udpin://127.0.0.1:{ports['companion']}"
    return Simulator("ardupilot", sysid, url, station, process, log)


def px4(_index: int, folder: Path, extra: Mapping[str, float]) -> Simulator:
    """Start one as the first free instance, whose number sets its ports and its sysid."""
    build = _path(PX4)
    instance = _free_instance()
    parameters = {
        "SDLOG_BACKEND": 0,
        "COM_RC_IN_MODE": 1,
        "RTL_RETURN_ALT": 4,
        "RTL_DESCEND_ALT": 4,
        **extra,
    }
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": str(folder),
        "PX4_SIM_MODEL": "sihsim_quadx",
        **{f"PX4_PARAM_{name}": f"{value}" for name, value in parameters.items()},
    }
    words = [build / "bin/px4", "-i", instance, "-d", "-s", "etc/init.d-posix/rcS", build / "etc"]
    process, log = _start(words, folder, environment)
    _await_ports(process, instance)
    station = _listener()
    station.connect(("127.0.0.1", 18570 + instance))
    url = f"udpin://127.0.0.1:{14540 + instance}"
    return Simulator("px4", instance + 1, url, station, process, log)


STARTERS: dict[str, Starter] = {"ardupilot": arducopter, "px4": px4}


class Hangar:
    """All simulators of a session, each started when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._simulators: dict[str, list[Simulator]] = {}
        self._started = 0

    def have(self, autopilot: str, count: int = 2, **extra: float) -> Sequence[Simulator]:
        """Give so many of an autopilot; those that are started now get `extra` parameters."""
        there = self._simulators.setdefault(autopilot, [])
        while len(there) < count:
            self._started += 1
            folder = self._folder / f"{autopilot}{self._started}"
            folder.mkdir()
            there.append(STARTERS[autopilot](self._started, folder, extra))
        return there[:count]

    def discard(self, one: Simulator) -> None:
        """Stop one that is of no use any more; the next who asks gets a new one."""
        stop(one)
        self._simulators[one.autopilot].remove(one)

    def close(self) -> None:
        """Stop them all."""
        everyone = [one for some in self._simulators.values() for one in some]
        self._simulators.clear()
        for one in everyone:
            one.process.terminate()
        for one in everyone:
            stop(one)


def stop(one: Simulator) -> None:
    """End a simulator, by force if it must be."""
    one.process.terminate()
    try:
        one.process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        one.process.kill()
        one.process.wait()
    one.station.close()


def _path(variable: str) -> Path:
    """Find a simulator, or skip the test with the reason."""
    told = os.environ.get(variable)
    if not told:
        pytest.skip(
            f"flies a real autopilot's simulator: set {variable}, see docs/real_vehicles.md"
        )
    path = Path(told).absolute()
    if not path.exists():
        pytest.fail(f"{variable}={told}: nothing is there")
    return path


def _start(
    words: Sequence[object], folder: Path, environment: Mapping[str, str] | None = None
) -> tuple[subprocess.Popen[bytes], Path]:
    log = folder / "out.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [str(word) for word in words],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # a Ctrl-C is for the test, which stops it afterwards
        )
    return process, log


def _listener() -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", 0))
    return listener


def _free_port() -> int:
    with _listener() as probe:
        return int(probe.getsockname()[1])


def _free_instance() -> int:
    """Find an instance number of PX4 whose ports nobody has; from 10 on all call one port."""
    return next(number for number in range(10) if all(map(_is_free, _ports(number))))


def _await_ports(process: subprocess.Popen[bytes], instance: int) -> None:
    """Wait until it has taken its ports, so that the next one chooses others."""
    deadline = time.monotonic() + START_S
    while any(map(_is_free, _ports(instance)[1:])):
        assert process.poll() is None, f"PX4 ended with {process.returncode}"
        assert time.monotonic() < deadline, f"PX4 does not open its ports within {START_S} s"
        time.sleep(0.05)  # noqa: TID251 - a simulator starts in real time


def _ports(instance: int) -> list[int]:
    """Give the ports of its companion, and its own for companion and ground station."""
    return [first + instance for first in (14540, 14580, 18570)]


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
