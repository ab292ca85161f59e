"""Mission files: the only reader of the YAML that says what a swarm does."""

import difflib
import re
from collections.abc import Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from swarm_ctl.agent.params import FlightParams, Limits
from swarm_ctl.errors import MissionError
from swarm_ctl.explore.planner import PlannerParams


class Mission(BaseModel):
    """What a swarm does: where, how many, for how long, and by which rules."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=60)
    """Short name, also of the run folder; the file's own name if left out."""
    world: Path
    """World file the mock simulates, relative to the mission file."""
    vehicles: int = Field(default=10, ge=1, le=250)
    """Number of vehicles; their sysids are 1, 2, 3 and so on."""
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
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Seed of every random draw; the same seed repeats a run in virtual time."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for key, reason in _cross_checks(self):
            raise PydanticCustomError("cross_check", "{reason}", {"key": key, "reason": reason})
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
    seed: int | None = None,
    duration_s: float | None = None,
) -> Mission:
    """Read and validate a mission file; what is not None replaces the file's own value.

    An overriding `world` is relative to the working directory, the file's to the file.
    Raises MissionError, one sentence that names file and key.
    """
    raw = _read(path)
    raw.setdefault("name", path.stem)
    given = {
        "vehicles": vehicles,
        "autopilot": autopilot,
        "seed": seed,
        "duration_s": duration_s,
    }
    raw.update({key: value for key, value in given.items() if value is not None})
    if planner is not None:
        block = raw.get("planner") or {}
        raw["planner"] = {**block, "kind": planner} if isinstance(block, Mapping) else block
    if world is not None:
        raw["world"] = Path.cwd() / world
    elif isinstance(raw.get("world"), str):
        raw["world"] = path.parent / raw["world"]
    if isinstance(raw.get("world"), Path):
        raw["world"] = raw["world"].resolve()
    try:
        mission = Mission.model_validate(raw)
    except ValidationError as error:
        raise _as_mission_error(path, error) from None
    if not mission.world.is_file():
        raise MissionError(path, "world", f"there is no world file {mission.world}")
    return mission


def mission_schema() -> dict[str, Any]:
    """Give the JSON Schema of a mission file, for editors."""
    schema = Mission.model_json_schema()
    schema["required"] = [key for key in schema["required"] if key != "name"]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _cross_checks(mission: Mission) -> Iterator[tuple[str, str]]:
    """Name every key that does not fit another one, with a sentence."""
    planner, flight, limits = mission.planner, mission.flight, mission.limits
    floor, ceiling = (
        f"limits.floor_m ({limits.floor_m:g})",
        f"limits.ceiling_m ({limits.ceiling_m:g})",
    )
    if planner.avoid_distance_m < limits.wall_m + 0.1 - 1e-9:
        # the deadlock of the study: the safety filter stops a vehicle before Table I fires
        reason = (
            f"must be at least {limits.wall_m + 0.1:g}, which is limits.wall_m and 0.1 m, not "
            f"{planner.avoid_distance_m:g}: a vehicle would stop before it turns away"
        )
        yield "planner.avoid_distance_m", reason
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
        reason = (
            f"must be below limits.battery_reserve ({limits.battery_reserve:g}), "
            f"not {limits.battery_critical:g}"
        )
        yield "limits.battery_critical", reason
    if limits.link_hold_s > limits.link_lost_s:
        reason = (
            f"must be at most limits.link_lost_s ({limits.link_lost_s:g}), "
            f"not {limits.link_hold_s:g}"
        )
        yield "limits.link_hold_s", reason
    if limits.planner_stall_s < planner.period_s + 0.2 - 1e-9:
        reason = (
            f"must be at least {planner.period_s + 0.2:g}, which is planner.period_s and 0.2 s, "
            f"not {limits.planner_stall_s:g}: every plan would count as stalled"
        )
        yield "limits.planner_stall_s", reason
    if mission.duration_s >= limits.max_time_s:
        yield (
            "duration_s",
            f"must be below limits.max_time_s ({limits.max_time_s:g}), not {mission.duration_s:g}",
        )


class _Loader(yaml.SafeLoader):
    """YAML that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            name = str(key_node.value)
            if name in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"{name} is given twice", problem_mark=key_node.start_mark
                )
            seen.add(name)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(  # YAML 1.1 takes 1e-3 for text
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def _read(path: Path) -> dict[str, Any]:
    try:
        raw = yaml.load(path.read_text(encoding="utf-8"), _Loader)  # noqa: S506 - a SafeLoader
    except FileNotFoundError:
        raise MissionError(path, "", "there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise MissionError(path, "", f"cannot be read: {reason}") from None
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        problem = error.problem or "this is not YAML"
        raise MissionError(path, "", f"{line}{problem}") from None
    except yaml.YAMLError as error:
        first = str(error).splitlines()[0]
        raise MissionError(path, "", f"this is not YAML: {first}") from None
    if not isinstance(raw, dict):
        raise MissionError(path, "", "a mission is a block of lines like `vehicles: 10`")
    for block in ("planner", "flight", "limits"):
        if raw.get(block, ...) is None:
            del raw[block]  # a heading with nothing beneath means the defaults
    return raw


def _as_mission_error(path: Path, error: ValidationError) -> MissionError:
    """Pick the first mistake, an unknown key before its consequences, and say it plainly."""
    details = sorted(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")
    detail = details[0]
    context = detail.get("ctx", {})
    key = str(context.get("key") or ".".join(str(part) for part in detail["loc"]))
    return MissionError(path, key, _reason(detail))


def _reason(detail: ErrorDetails) -> str:
    """Say in plain words what pydantic found."""
    kind, given, context = detail["type"], _shown(detail["input"]), detail.get("ctx", {})
    if kind in _SENTENCES:
        return _SENTENCES[kind].format(given=given, **context)
    if kind == "extra_forbidden":
        return _unknown_key(detail["loc"])
    words = next((words for name, words in _TYPES.items() if kind.startswith(name)), None)
    return f"must be {words}, not {given}" if words else f"{detail['msg']}, not {given}"


_SENTENCES = {
    "missing": "is missing",
    "invalid_key": "unknown key; keys are words",
    "cross_check": "{reason}",
    "value_error": "{error}",
    "literal_error": "must be {expected}, not {given}",
    "greater_than_equal": "must be at least {ge:g}, not {given}",
    "greater_than": "must be more than {gt:g}, not {given}",
    "less_than_equal": "must be at most {le:g}, not {given}",
    "less_than": "must be less than {lt:g}, not {given}",
    "string_pattern_mismatch": "may hold only letters, digits, - and _, not {given}",
    "string_too_long": "may have {max_length} characters at most",
}
_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "finite_number": "a finite number",
    "bool": "true or false",
    "string": "text",
    "model": "a block of keys",
    "is_instance_of": "the path of a file",
    "path": "the path of a file",
}


def _unknown_key(loc: Sequence[int | str]) -> str:
    """Name the nearest known key: in the same block first, then anywhere in a mission."""
    *block, last = (str(part) for part in loc)
    fields = _fields(block)
    for names, prefix in ((fields, [*block]), (_all_keys(), [])):
        # anywhere means its last part: `inertia` at the top level belongs to planner
        by_last = {name.split(".")[-1]: name for name in names}
        close = difflib.get_close_matches(last, by_last, n=1, cutoff=0.6)
        if close:
            return f"unknown key; did you mean {'.'.join([*prefix, by_last[close[0]]])}?"
    return f"unknown key; known here are {', '.join(fields)}"


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
        for block in ([], ["planner"], ["flight"], ["limits"])
        for name in _fields(block)
    ]


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a block of keys"
    if isinstance(value, list | tuple):
        return "a list"
    if value is None:
        return "nothing"
    return repr(value) if isinstance(value, str) else str(value)
