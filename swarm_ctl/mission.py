"""Mission files: the only reader of the YAML that says what a swarm does."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, Field, ValidationError, model_validator

from swarm_ctl.agent.frame import FrameParams, mistakes
from swarm_ctl.agent.params import FlightParams, Limits, RangingParams
from swarm_ctl.errors import MissionError, SwarmError
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.link.url import parse_peers
from swarm_ctl.sections import Section, cross_check, first_mistake, in_words, read_yaml, unknown_key

OPTIONS = {
    "vehicles": "--vehicles",
    "autopilot": "--autopilot",
    "peers": "--peers",
    "seed": "--seed",
    "duration_s": "--duration",
    "world": "--world",
    "planner.kind": "--planner",
}
"""What replaces a key of the file, by the key."""
VEHICLES_MAX = 250
"""Of one MAVLink network, whose sysids are a byte."""
BLOCKS = ("planner", "flight", "limits", "frame", "ranging")
"""Sections of a mission file, which are blocks of keys."""


class Mission(Section):
    """What a swarm does: where, how many, for how long, and by which rules."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=60)
    """Short name, also of the run folder; the file's own name if left out."""
    world: Path | None = None
    """World file the mock simulates, relative to the mission file; real vehicles need none."""
    vehicles: int = Field(default=10, ge=1, json_schema_extra={"maximum": VEHICLES_MAX})
    """Number of vehicles; their sysids are 1, 2, 3 and so on. More than 250 fly as several
    missions, each a MAVLink network of its own."""
    autopilot: Literal["px4", "ardupilot", "mixed"] = "px4"
    """What the mock vehicles behave like; `mixed` alternates."""
    duration_s: float = Field(gt=0.0, le=86_400.0)
    """Time each vehicle explores, in seconds, before it comes home."""
    planner: PlannerParams = PlannerParams()
    """How a vehicle decides where to go."""
    flight: FlightParams = FlightParams()
    """How a vehicle takes off, moves and comes home."""
    limits: Limits = Limits()
    """What geofence and failsafe hold against every planner."""
    frame: FrameParams = FrameParams()
    """Which frame the vehicles share, beside what their radios measure."""
    peers: str = "autopilot"
    """What carries peers' frames beside their autopilots: an address as of `--peers`, or nothing
    else. In virtual time the mock's radio is all there is."""
    ranging: RangingParams = RangingParams()
    """How well their radios measure where a peer is."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Seed of every random draw; the same seed repeats a run in virtual time."""

    @property
    def simulated(self) -> Path:
        """The world file; SwarmError when the mission has none."""
        if self.world is None:
            raise SwarmError(f"{self.name}: names no world to simulate")
        return self.world

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for key, sentence in _cross_checks(self):
            raise cross_check(key, sentence)
        return self

    def dump(self) -> dict[str, Any]:
        """Give every resolved value, ready for JSON."""
        return self.model_dump(mode="json")


def load_mission(
    path: Path,
    *,
    world: Path | None = None,
    vehicles: int | None = None,
    planner: str | None = None,
    autopilot: str | None = None,
    peers: str | None = None,
    seed: int | None = None,
    duration_s: float | None = None,
    open_air: bool | None = None,
    is_simulated: bool = True,
) -> Mission:
    """Read and validate a mission file; what is not None replaces the file's own value.

    An overriding `world` is relative to the working directory, the file's to the file; a mission
    that is not simulated needs none. Raises MissionError, one sentence that names file and key.
    """
    raw = _read(path)
    raw.setdefault("name", path.stem)
    options = {
        "vehicles": vehicles,
        "autopilot": autopilot,
        "peers": peers,
        "seed": seed,
        "duration_s": duration_s,
    }
    given = {key: value for key, value in options.items() if value is not None}
    raw.update(given)
    for block, key, value in (("planner", "kind", planner), ("flight", "open_air", open_air)):
        section = raw.get(block) or {}
        if value is not None and isinstance(section, Mapping):
            raw[block] = {**section, key: value}
    if world is not None:
        raw["world"] = Path.cwd() / world
    elif isinstance(raw.get("world"), str):
        raw["world"] = path.parent / raw["world"]
    if isinstance(raw.get("world"), Path):
        raw["world"] = raw["world"].resolve()
    try:
        mission = Mission.model_validate(raw)
    except ValidationError as error:
        replaced = {*given, *({"planner.kind"} if planner is not None else ())}
        raise _as_mission_error(path, error, replaced) from None
    if is_simulated:
        _check_world(path, mission, "--world" if world is not None else "")
        check_starts(path, mission, range(1, mission.vehicles + 1))
    return mission


def check_starts(path: Path, mission: Mission, sysids: Iterable[int]) -> None:
    """Refuse a mission in whose surveyed frame a vehicle that is to fly has no start."""
    for sysid in sysids:
        if mission.frame.shared == "surveyed" and sysid not in mission.frame.starts_m:
            reason = f"lacks vehicle {sysid}; all that fly must be in it"
            raise MissionError(path, "frame.starts_m", reason)


def _check_world(path: Path, mission: Mission, option: str) -> None:
    if mission.world is None:
        reason = "is missing; name a world file to simulate, here or by --world"
        raise MissionError(path, "world", reason)
    if not mission.world.is_file():
        raise MissionError(path, "world", f"there is no world file {mission.world}", option)


def mission_schema() -> dict[str, Any]:
    """Give the JSON Schema of a mission file, for editors."""
    schema = Mission.model_json_schema()
    schema["required"] = [key for key in schema["required"] if key != "name"]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _too_many(vehicles: int) -> Iterator[tuple[str, str]]:
    """Say what to do with more vehicles than a MAVLink network has."""
    if vehicles > VEHICLES_MAX:
        sentence = (
            f"must be at most {VEHICLES_MAX}, not {vehicles}, in one MAVLink network; fly more as "
            "groups, a mission for each (docs/scaling.md)"
        )
        yield "vehicles", sentence


def _cross_checks(mission: Mission) -> Iterator[tuple[str, str]]:
    """Name every key that does not fit another one, with a sentence."""
    planner, flight, limits = mission.planner, mission.flight, mission.limits
    floor, ceiling = (
        f"limits.floor_m ({limits.floor_m:g})",
        f"limits.ceiling_m ({limits.ceiling_m:g})",
    )
    if planner.avoid_distance_m < limits.wall_m + 0.1 - 1e-9:
        # the deadlock of the study: the safety filter stops a vehicle before Table I fires
        sentence = (
            f"must be at least {limits.wall_m + 0.1:g}, which is limits.wall_m and 0.1 m, not "
            f"{planner.avoid_distance_m:g}: a vehicle would stop before it turns away"
        )
        yield "planner.avoid_distance_m", sentence
    if limits.floor_m >= limits.ceiling_m:
        yield "limits.floor_m", f"must be below {ceiling}, not {limits.floor_m:g}"
    if not limits.floor_m <= flight.height_m <= limits.ceiling_m:
        yield (
            "flight.height_m",
            f"must lie between {floor} and {ceiling}, not at {flight.height_m:g}",
        )
    if planner.dimensions == 3 and limits.ceiling_m - limits.floor_m < 1.0:
        yield (
            "planner.dimensions",
            f"3 needs at least 1 m between {floor} and {ceiling}; raise the ceiling or fly in 2",
        )
    if limits.battery_critical >= limits.battery_reserve > 0.0:
        sentence = (
            f"must be below limits.battery_reserve ({limits.battery_reserve:g}), "
            f"not {limits.battery_critical:g}"
        )
        yield "limits.battery_critical", sentence
    if limits.link_hold_s > limits.link_lost_s:
        sentence = (
            f"must be at most limits.link_lost_s ({limits.link_lost_s:g}), "
            f"not {limits.link_hold_s:g}"
        )
        yield "limits.link_hold_s", sentence
    if limits.planner_stall_s < planner.period_s + 0.2 - 1e-9:
        sentence = (
            f"must be at least {planner.period_s + 0.2:g}, which is planner.period_s and 0.2 s, "
            f"not {limits.planner_stall_s:g}: every plan would count as stalled"
        )
        yield "limits.planner_stall_s", sentence
    if mission.duration_s >= limits.max_time_s:
        yield (
            "duration_s",
            f"must be below limits.max_time_s ({limits.max_time_s:g}), not {mission.duration_s:g}",
        )
    yield from _too_many(mission.vehicles)
    yield from mistakes(mission.frame)
    try:
        parse_peers(mission.peers)
    except SwarmError as error:
        yield "peers", str(error)


def _read(path: Path) -> dict[str, Any]:
    raw = read_yaml(path, "a mission is a block of lines like `vehicles: 10`")
    if isinstance(flown := raw.get("mission"), dict):
        raw = _to_fly_again(flown)
    for block in BLOCKS:
        if raw.get(block, ...) is None:
            del raw[block]  # a heading with nothing beneath means the defaults
    return raw


def _to_fly_again(flown: dict[str, Any]) -> dict[str, Any]:
    """Take the mission of a run's `mission.json`, where JSON has made text of the sysids."""
    frame = flown.get("frame")
    for key in ("starts_m", "yaw_offset_deg"):
        if isinstance(frame, dict) and isinstance(by_sysid := frame.get(key), dict):
            frame[key] = {
                int(sysid) if str(sysid).isdecimal() else sysid: value
                for sysid, value in by_sysid.items()
            }
    return flown


def _as_mission_error(path: Path, error: ValidationError, replaced: set[str]) -> MissionError:
    detail = first_mistake(error)
    key = str(detail.get("ctx", {}).get("key") or ".".join(map(str, _named(detail["loc"]))))
    option = OPTIONS[key] if key in replaced else ""
    return MissionError(path, key, in_words(detail, _unknown_key), option)


def _named(loc: Sequence[int | str]) -> list[int | str]:
    """Leave out what pydantic says of a key that is no good in itself."""
    return [part for part in loc if part != "[key]"]


def _unknown_key(loc: Sequence[int | str]) -> str:
    """Name the nearest known key: in the same block first, then anywhere in a mission."""
    *block, last = (str(part) for part in loc)
    fields = _fields(block)
    near = {name: ".".join([*block, name]) for name in fields}
    # anywhere means its last part: `inertia` at the top level belongs to planner
    anywhere = {name.split(".")[-1]: name for name in _all_keys()}
    return unknown_key(last, (near, anywhere), fields)


def _fields(block: Sequence[str]) -> list[str]:
    model: type[BaseModel] = Mission
    for part in block:
        inner = model.model_fields[part].annotation
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        model = inner
    return list(model.model_fields)


def _all_keys() -> list[str]:
    return [
        ".".join([*block, name])
        for block in ([], *([block] for block in BLOCKS))
        for name in _fields(block)
    ]
