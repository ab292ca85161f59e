"""Every mistake that a user can make is one sentence: where, what was expected, what to do."""

from __future__ import annotations

import errno
import os
import resource
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PIL import Image

import mock_vehicle.cli
import swarm_ctl.cli
from swarm_ctl.errors import plain

Typed = tuple[int, str]
Type = Callable[..., Typed]

MISSION = {"mission.yaml": "duration_s: 10\nvehicles: 2\nworld: world.yaml\n"}
WORLD = {"world.yaml": "name: hall\nsize_m: [10, 10]\nceiling_m: 3\n"}
MAP = "resolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
FLY = "swarm-ctl fly mission.yaml --connect"
RUN = "swarm-ctl run mission.yaml --virtual"
EXPERIMENT = "swarm-ctl experiment experiment.yaml --trials 1 --out results"


@pytest.fixture
def type_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Type:
    """Type a command in a folder with a mission and a world; give exit status and complaint."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    for name, text in (MISSION | WORLD).items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    def type_in(command: str, **files: str) -> Typed:
        for name, text in files.items():
            (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        words = command.split()
        main = swarm_ctl.cli.main if words[0] == "swarm-ctl" else mock_vehicle.cli.main
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().err

    return type_in


def is_one_sentence(complaint: str) -> bool:
    return len(complaint.strip().splitlines()) == 1 and "Traceback" not in complaint


OPTIONS = {
    "swarm-ctl fli": "no such command 'fli'; did you mean 'fly'?",
    "swarm-ctl run": "swarm-ctl run: missing argument 'mission' (see swarm-ctl run --help)",
    "swarm-ctl run absent.yaml": "absent.yaml: there is no such file",
    "swarm-ctl run .": ".: cannot be read: Is a directory",
    f"{RUN} --vehicels 3": "there is no option --vehicels; did you mean --vehicles?",
    f"{RUN} --vehicles many": "--vehicles: must be a whole number, not 'many'",
    f"{RUN} --vehicles 0": "mission.yaml: --vehicles: must be at least 1, not 0",
    f"{RUN} --vehicles": "option '--vehicles' requires an argument",
    f"{RUN} --speed 0": "--speed: must be at least 0.1, not '0'",
    f"{RUN} --speed nan": "--speed: must be at most 100, not 'nan'",
    f"{RUN} --seed -1": "mission.yaml: --seed: must be at least 0, not -1",
    f"{RUN} --duration -5": "mission.yaml: --duration: must be more than 0, not -5.0",
    f"{RUN} --duration inf": "mission.yaml: --duration: must be a finite number, not inf",
    f"{RUN} --duration 5000": "--duration: must be below limits.max_time_s (1800), not 5000",
    f"{RUN} --planner ants": "--planner: must be 'lf-pso', 'levy', 'pso', 'explore' or your own",
    f"{RUN} --planner no.such:Planner": "--planner: cannot import no.such here or from what is",
    f"{RUN} --autopilot betaflight": "--autopilot: must be 'px4', 'ardupilot' or 'mixed', not",
    f"{RUN} --world absent.yaml": "mission.yaml: --world: there is no world file",
    f"{RUN} --fault nonsense": "--fault nonsense: expected KIND:SYSID@SECONDS, as dead:3@60",
    f"{RUN} --fault ded:1@6": "--fault ded:1@6: 'ded' is no fault; did you mean 'dead'?",
    f"{RUN} --fault dead:30@6": "fault dead:30@6: there is no vehicle 30; they are 1 to 2",
    f"{RUN} --fault dead:1@soon": "--fault dead:1@soon: 'soon' is no number",
    f"{RUN} --fault controller:7@3": "there is no vehicle 7; they are 1 to 2",
    f"{RUN} --fault link-loss:1@1,fractoin=1": "did you mean 'fraction'?",
    f"{RUN} --fault link-loss:1@1,fraction=7": "fraction: should be 0 to 1, not 7.0",
    "swarm-ctl run mission.yaml --mqtt broker": "--mqtt: expected mqtt://[USER@]HOST[:PORT], or",
    "swarm-ctl run mission.yaml --mqtt mqtt://x:99999": "--mqtt: expected mqtt://",
    f"{RUN} --mqtt mqtt://localhost": "--mqtt: there is no time for orders in --virtual",
    f"{RUN} --peers pigeons": "expected autopilot, udp://GROUP:PORT",
    f"{RUN} --peers udp://1.2.3.4": "expected a multicast group and a port",
    f"{RUN} --peers udp://239.255.42.42:1470": "--peers: in --virtual the mock's radio is all",
    f"{RUN} --signing-key absent": "signing key absent: No such file or directory",
    f"{RUN} --signing-key .": "signing key .: Is a directory",
    f"{RUN} --out world.yaml": "cannot be the run folder: this is a file; name a folder",
    f"{RUN} --out world.yaml/x": "cannot be the run folder: part of its path is a file",
    f"{RUN} --out /proc/x": "cannot be the run folder: No such file or directory",
    f"{RUN} --out .": "holds files already; name a new or an empty folder",
    "swarm-ctl schema more": "got unexpected extra argument(s) (more)",
    FLY: "option '--connect' requires an argument",
    f"{FLY} nonsense": "nonsense: expected udpin://HOST:PORT, udpout://HOST:PORT, tcpout://",
    f"{FLY} udpin:0.0.0.0:14540": "udpin:0.0.0.0:14540: expected udpin://HOST:PORT",
    f"{FLY} udpin://0.0.0.0": "udpin://0.0.0.0: expected udpin://HOST:PORT",
    f"{FLY} udpin://0.0.0.0:99999": "expected udpin://HOST:PORT, with a port of 1 to",
    f"{FLY} udpin://192.0.2.1:14540": "this machine has no such address; 0.0.0.0 stands for all",
    f"{FLY} udpout://host..invalid:1": "udpout://host..invalid:1: ",
    f"{FLY} serial:///dev/ttyNONE:57600": "No such file or directory; is it plugged in?",
    f"{FLY} serial:///dev/null:57600": "serial:///dev/null:57600: this is no serial port",
    f"{FLY} serial:///dev/ttyACM0:fast": "expected serial:///DEVICE:BAUD, as serial:///dev/",
    f"{FLY} udpin://:1 --connect udpin://:2": "several --connect want --sysid",
    f"{FLY} udpin://0.0.0.0:0 --sysid 300": "--sysid 300: a vehicle's sysid is 1 to 255",
    f"{FLY} udpin://0.0.0.0:0 --sysid 1 --sysid 1": "--sysid 1: given twice",
    "swarm-ctl doctor": "missing option '--connect'",
    "swarm-ctl doctor --connect udpin://0.0.0.0:0 --timeout 0": "--timeout: must be at least 1",
    "swarm-ctl doctor --connect udpin://0.0.0.0:0 --timeout 1": "no autopilot is heard",
    "swarm-ctl doctor --connect udpin://0.0.0.0:0 --mission no.yaml": "no.yaml: there is no such",
    "swarm-ctl experiment absent.yaml": "absent.yaml: there is no such file",
    "swarm-ctl experiment mission.yaml": "unknown key; did you mean defaults.",
    "swarm-ctl soak": "soak: name either --seeds A..B or --scenario FILE",
    "swarm-ctl soak --seeds few": "--seeds few: expected A..B, as 1..1000, or one seed",
    "swarm-ctl soak --seeds 1..1 --out world.yaml/x": "cannot be written: ",
    "swarm-ctl soak --scenario absent.json": "absent.json: there is no such file",
    "swarm-ctl order": "missing argument 'ORDER'; choose from: start, pause, resume, return, land,",
    "swarm-ctl order fly --mqtt mqtt://x --mission x": "'fly' is not one of 'start', 'pause',",
    "swarm-ctl order land --mqtt mqtt://127.0.0.1:1 --mission x": "mqtt://127.0.0.1:1: ",
    "swarm-ctl order land --mqtt mqtt://x --mission x/y": "--mission x/y: expected the name of a",
    "swarm-ctl report absent": "absent: is no run folder: it has no mission.json of a run",
    "swarm-ctl export absent --format kml": "absent: is no run folder",
    "swarm-ctl export . --format pdf": "--format pdf: expected one of mcap, geojson, plan,",
    "swarm-ctl console --port 99999": "--port: must be at most 65535, not '99999'",
    "swarm-ctl console --mqtt broker": "--mqtt: expected mqtt://[USER@]HOST[:PORT]",
    "mock-vehicle absent.yaml": "absent.yaml: cannot be read: No such file or directory",
    "mock-vehicle --vehicles 3 --sysid 254": "--sysid 254: sysids would end at 256, not 255",
    "mock-vehicle --ports 1-2 --vehicles 3": "--ports 1-2: names 2 ports for 3 vehicles",
    "mock-vehicle --ports x": "--ports x: expected ports, as 14580,14590 or 14580-14589",
    "mock-vehicle --remote here": "--remote here: expected HOST:PORT, as 127.0.0.1:14540",
    "mock-vehicle --host 192.0.2.1": "cannot listen on 192.0.2.1:14580: ",
    "mock-vehicle --param absent.params": "mock-vehicle: absent.params: No such file or directory",
    "mock-vehicle --param world.yaml": "world.yaml:1: ",
    "mock-vehicle --fault dead:3@60": "fault dead:3@60: there is no vehicle 3; they are 1 to 1",
    "mock-vehicle --faults absent.yaml": "absent.yaml: cannot be read: No such file or directory",
    "mock-vehicle --signing-key absent": "signing key absent: No such file or directory",
    "mock-vehicle --out world.yaml --duration 0.1 --port 0": "world.yaml: File exists",
}
"""What is typed in a folder with a mission and a world, and what is said."""


@pytest.mark.parametrize(("command", "sentence"), OPTIONS.items(), ids=OPTIONS)
def test_a_mistake_in_a_command_is_one_sentence(type_in: Type, command: str, sentence: str) -> None:
    code, complaint = type_in(command)
    assert sentence in complaint
    assert is_one_sentence(complaint)
    assert code == 2


HEAD = MISSION["mission.yaml"]
MISSIONS = {
    "": "a mission is a block of lines like `vehicles: 10`",
    "[]": "a mission is a block of lines",
    "a: b: c": "line 1: a colon too many, or an indent unlike its neighbours'",
    "\tx: 1": "line 1: a tab; indent with spaces",
    "planner: {kind: explore": "line 1: a bracket or quote is not closed",
    "x: !!python/object:os.system 3": "line 1: a tag (!...) is not taken here; write a plain value",
    "planner: *nowhere": "line 1: found undefined alias 'nowhere'",
    "duration_s: 10": "world: is missing; name a world file to simulate, here or by --world",
    "world: world.yaml": "duration_s: is missing",
    HEAD + "vehicles: 3": "line 4: vehicles is given twice",
    HEAD + "vehicels: 3": "vehicels: unknown key; did you mean vehicles?",
    HEAD + "speed_m_s: 3": "speed_m_s: unknown key; did you mean flight.speed_m_s?",
    HEAD + "1: 2": "1: unknown key; keys are words",
    HEAD + "name: a b": "name: may hold only letters, digits, - and _, not 'a b'",
    HEAD + "limits: {radius_m: .nan}": "limits.radius_m: must be a finite number, not nan",
    HEAD + "limits: {radius_m: 1e9}": "limits.radius_m: must be at most 10000, not 1000000000.0",
    HEAD + "limits: {radius_m: far}": "limits.radius_m: must be a number, not 'far'",
    HEAD + "limits: 3": "limits: must be a block of keys, not 3",
    HEAD + "flight: {height_m: 50}": "flight.height_m: must lie between limits.floor_m (0.4) and",
    HEAD
    + "planner: {levy_min_m: 9, levy_max_m: 3}": "planner.levy_min_m: must be at most levy_max_m",
    HEAD + "planner: {dimensions: 4}": "planner.dimensions: must be 2 or 3, not 4",
    HEAD + "frame: {shared: surveyed}": "frame.starts_m: is missing; it says where each vehicle",
    HEAD + "frame: {shared: surveyed, starts_m: {1: [0, 0]}}": "frame.starts_m.1.2: is missing",
    HEAD + "frame: {origin: here}": "frame.origin: must be a list, not 'here'",
    HEAD + "peers: pigeons": "peers: pigeons: expected autopilot, udp://GROUP:PORT",
    "duration_s: 10\nworld: 7": "world: must be the path of a file, not 7",
    "duration_s: 10\nworld: absent.yaml": "world: there is no world file",
}
"""A mission file, and what is said of it."""


@pytest.mark.parametrize(("text", "sentence"), MISSIONS.items())
def test_a_mistake_in_a_mission_is_one_sentence(type_in: Type, text: str, sentence: str) -> None:
    code, complaint = type_in("swarm-ctl check mission.yaml", mission=text)
    assert complaint.startswith(f"mission.yaml: {sentence}")
    assert is_one_sentence(complaint)
    assert code == 2


HALL = "name: hall\nsize_m: [10, 10]\n"
WORLDS = {
    "": "should hold keys like name: and size_m:",
    "name: hall": "size_m: is required without a map",
    "name: hall\nsize_m: [10]": "size_m[1]: is required",
    "name: hall\nsize_m: [10, -1]": "size_m[1]: should be greater than 0, not -1",
    "name: hall\nsize_m: ten": "size_m: should be a list, not 'ten'",
    "name: hall\nsize_m: [.nan, 3]": "size_m[0]: should be a finite number, not nan",
    "name: hall\nsize_m: [0.1, 0.1]": "size_m: sides should be 1 to 2000 m, not 0.1 and 0.1",
    "name: hall\nsize_m: [1e6, 1e6]": "size_m: sides should be 1 to 2000 m, not 1e+06 and 1e+06",
    HALL + "size_m: [3, 3]": "size_m: is given twice, in lines 2 and 3",
    HALL + "boxxes: []": "boxxes: unknown key; did you mean boxes?",
    HALL + "boxes: [{center_m: [1, 1]}]": "boxes[0].size_m: is required",
    HALL + "boxes: [3]": "boxes[0]: should hold keys, not 3",
    HALL + "walls: [{from_m: [0, 0], to_m: [0, 0]}]": "walls[0].to_m: is the same point as from_m",
    HALL + "walls: [{from_m: [0, 5], to_m: [9, 5], doors: [{at_m: 50, width_m: 1}]}]": (
        "walls[0].doors[0].at_m: 50 m puts the door beyond the wall, which is 9 m long"
    ),
    HALL + "victims: [{name: a, position_m: [50, 50, 0]}]": "victims[0].position_m: (50, 50, 0) is",
    HALL + "starts: [{position_m: [5, 5]}]": "starts: lists 1 places, not 2",
    HALL + "starts: [{position_m: [50, 5]}, {position_m: [5, 5]}]": "starts[0].position_m: (50, 5)",
    HALL + "starts: {circle: 3}": "starts: should be a list of positions, {grid: ...} or",
    HALL + "starts: {random: {spacing_m: 50}}": "starts.random: there is room for 1 vehicles 50 m",
    HALL + "radio: {radius_m: far}": "radio.radius_m: should be a number, not 'far'",
    HALL + "radio: {partitions: [{from_s: 3}]}": "radio.partitions[0]: should have either groups",
    HALL + "coverage: {cell_m: 0.00001}": "coverage.cell_m: 1e-05 m cuts this world into 1e+12",
    HALL + "coverage: {footprint: ball}": "coverage.footprint: should be 'square', 'disc' or",
    HALL + "faults: [{time_s: 3, kind: ded}]": "faults[0].kind: 'ded' is no fault; did you mean",
    HALL + "ceiling_m: 1.6": "ceiling_m: 1.6 m is too low to fly at flight.height_m (1.5) with",
    HALL + "map: {file: map.yaml}": "size_m: cannot go with map, which has an extent of its own",
    "name: hall\nmap: {file: absent.yaml}": "map.file: absent.yaml does not exist",
}
"""A world file, and what is said of it."""


@pytest.mark.parametrize(("text", "sentence"), WORLDS.items())
@pytest.mark.parametrize("command", ["check mission.yaml", "run mission.yaml --virtual"])
def test_a_mistake_in_a_world_is_one_sentence(
    type_in: Type, command: str, text: str, sentence: str, tmp_path: Path
) -> None:
    code, complaint = type_in(f"swarm-ctl {command}", world=text)
    assert f"{tmp_path / 'world.yaml'}: {sentence}" in complaint
    assert is_one_sentence(complaint)
    assert code == 2
    assert not (tmp_path / "runs").exists() or not any((tmp_path / "runs").iterdir())


MAPS = {
    "image: absent.png\n" + MAP: "image: absent.png does not exist",
    "image: world.yaml\n" + MAP: "image: world.yaml cannot be read as an image",
    "image: cut.png\n" + MAP: "image: cut.png cannot be read as an image",
    "image: black.png\n" + MAP: "image: black.png has no free cell",
    "image: 3\n" + MAP: "image: should name the image file",
    "image: black.png\n": "resolution: is required",
    "image: black.png\n"
    + MAP.replace("0.1", "0"): "resolution: should be greater than 0 m, not 0.0",
    "image: black.png\n" + MAP.replace("0.1", "fine"): "resolution: should be a number, not 'fine'",
    "image: black.png\n" + MAP.replace("[0, 0, 0]", "3"): "origin: should be [x, y, yaw], not 3",
    "image: black.png\nmode: scale\n" + MAP: "mode: scale is not supported, only trinary is",
    "": "should hold keys like image: and resolution:",
}
"""A map file, and what is said of it."""


@pytest.mark.parametrize(("text", "sentence"), MAPS.items())
def test_a_broken_map_is_one_sentence(
    type_in: Type, text: str, sentence: str, tmp_path: Path
) -> None:
    Image.new("L", (50, 50), 0).save(tmp_path / "black.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "black.png").read_bytes()[:60])
    world = "name: hall\nmap: {file: map.yaml}"
    code, complaint = type_in("swarm-ctl check mission.yaml", world=world, map=text)
    assert f"map.yaml: {sentence}" in complaint
    assert is_one_sentence(complaint)
    assert code == 2


CELL = "cells:\n- {name: one, world: world.yaml, duration_s: 10, "
EXPERIMENTS = {
    "": "an experiment is a block of lines like `trials: 20`",
    "trials: 3": "cells: is missing",
    "cells: []": "cells: must hold at least one",
    "sample_s: some\n" + CELL + "vehicles: 2}": "sample_s: must be a number, not 'some'",
    CELL + "plannr: {}}": "cells.0.plannr: unknown key; did you mean planner?",
    CELL + "planner: {kind: ants}}": "cells.0.planner.kind: must be 'lf-pso', 'levy', 'pso',",
    CELL + "start_m: [50, 50]}": "cells.0.start_m: a robot of 0.6 m does not fit at (50.0, 50.0)",
}
"""An experiment file, and what is said of it."""


@pytest.mark.parametrize(("text", "sentence"), EXPERIMENTS.items())
def test_a_mistake_in_an_experiment_is_one_sentence(
    type_in: Type, text: str, sentence: str
) -> None:
    code, complaint = type_in(EXPERIMENT, experiment=text)
    assert f"experiment.yaml: {sentence}" in complaint
    assert is_one_sentence(complaint)
    assert code == 2


@pytest.fixture
def taken_port() -> Iterator[int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        yield int(taken.getsockname()[1])


def test_a_port_in_use_is_one_sentence(type_in: Type, taken_port: int) -> None:
    url = f"udpin://127.0.0.1:{taken_port}"
    for command in (f"{FLY} {url} --sysid 1", f"swarm-ctl doctor --connect {url}"):
        code, complaint = type_in(command)
        assert f"{url}: another program listens there already; end it, or" in complaint
        assert is_one_sentence(complaint)
        assert code == 2
    code, complaint = type_in(f"mock-vehicle --port {taken_port}")
    assert f"cannot listen on 127.0.0.1:{taken_port}: Address already in use" in complaint
    assert is_one_sentence(complaint)
    assert code == 2


MISSING: dict[str, tuple[str, str]] = {
    "serial": (f"{FLY} serial:///dev/ttyACM0:57600 --sysid 1", "swarm-ctl[serial]"),
    "optuna": ("swarm-ctl tune experiment.yaml", "swarm-ctl[tune]"),
    "distributed": (f"{EXPERIMENT} --cluster tcp://127.0.0.1:1", "swarm-ctl[cluster]"),
}


@pytest.mark.parametrize("extra", MISSING)
def test_a_missing_extra_is_named_with_the_way_to_get_it(
    type_in: Type, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    command, wanted = MISSING[extra]
    monkeypatch.setitem(sys.modules, extra, None)
    for module in ("tune", "cluster"):  # as if nobody had asked for it before
        monkeypatch.delitem(sys.modules, f"swarm_ctl.experiment.{module}", raising=False)
    tuned = "trials: 1\ntune: {parameters: {inertia: {low: 0.3, high: 0.9}}}\n"
    code, complaint = type_in(command, experiment=tuned + CELL + "vehicles: 2}")
    assert f"missing: pip install '{wanted}'" in complaint
    assert is_one_sentence(complaint)
    assert code == 2


@pytest.fixture
def small_files() -> Iterator[None]:
    """Let no file grow beyond a few bytes, which is how a full disk looks to who writes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, ignored)


@pytest.mark.usefixtures("small_files")
def test_a_record_that_cannot_be_written_is_one_sentence(type_in: Type) -> None:
    code, complaint = type_in(f"{RUN} --duration 1")
    assert "File too large" in complaint
    assert is_one_sentence(complaint)
    assert code == 1


def test_a_full_disk_says_what_to_do() -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert plain(full) == "the disk is full; make room, or name a folder on another one"


def test_an_unknown_host_is_said_so() -> None:
    assert plain(socket.gaierror(-2, "Name or service not known")).startswith("there is no host")
