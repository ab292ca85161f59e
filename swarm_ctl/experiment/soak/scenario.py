"""One bad day in full: a mission, its world, what breaks in it and who interferes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from mock_vehicle.errors import WorldError
from mock_vehicle.faults import check, parse_fault
from mock_vehicle.world import World, WorldSpec, build_world
from swarm_ctl.errors import MissionError, SwarmError
from swarm_ctl.flight import Faults
from swarm_ctl.mission import Mission
from swarm_ctl.model import Operator
from swarm_ctl.sections import (
    Section,
    cross_check,
    first_mistake,
    in_words,
    read_yaml,
    unknown_key,
)

Seconds = Annotated[float, Field(ge=0.0, le=86_400.0)]
Sysid = Annotated[int, Field(ge=1, le=250)]


class Order(Section):
    """An operator's order."""

    time_s: Seconds
    """Mission time."""
    sysid: Sysid | None = None
    """To whom; null: to everybody."""
    operator: Annotated[Operator, Field(strict=False)]
    """What is ordered."""


class Takeover(Section):
    """A pilot who chooses another mode from a ground station."""

    time_s: Seconds
    """Mission time."""
    sysid: Sysid
    """Of which vehicle."""
    mode: Literal["hold", "land"]
    """Where it stands in the air, or down here."""


class Scenario(Section):
    """What a seed stands for, or a file that somebody has written; the same bits every time."""

    seed: int = Field(ge=0, lt=2**63)
    """Seed of every draw in the flight."""
    mission: Mission
    """Keys of a mission file, but `world` and `seed`."""
    world: WorldSpec
    """Keys of a world file."""
    faults: tuple[str, ...] = Field(default=(), strict=False)
    """What breaks, in the words of `--fault`."""
    orders: tuple[Order, ...] = Field(default=(), strict=False)
    """What operators order."""
    takeovers: tuple[Takeover, ...] = Field(default=(), strict=False)
    """Where pilots interfere."""

    @model_validator(mode="before")
    @classmethod
    def _seed_the_mission(cls, data: Any) -> Any:
        """Let one seed do for all."""
        if isinstance(data, dict) and isinstance(data.get("mission"), dict):
            mission = {**data["mission"], "seed": data.get("seed", 0)}
            return {**data, "mission": {"name": "soak", **mission}}
        return data

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        try:
            faults = Faults.parse(self.faults, self.mission.vehicles).mock
            check(map(parse_fault, faults), range(1, self.mission.vehicles + 1))
        except (SwarmError, ValueError) as error:
            raise cross_check("faults", str(error)) from None
        for key, acts in (("orders", self.orders), ("takeovers", self.takeovers)):
            if any((act.sysid or 1) > self.mission.vehicles for act in acts):
                raise cross_check(key, f"there are only {self.mission.vehicles} vehicles")
        return self

    def build_world(self, path: Path) -> World:
        """Build the world; `path` is what an error names, and where a map lies."""
        try:
            return build_world(path, self.world)
        except WorldError as error:
            raise SwarmError(str(error)) from None

    def keys(self) -> dict[str, Any]:
        """Give the keys that were set, ready for JSON: what a file of it holds."""
        keys = self.model_dump(mode="json", exclude_unset=True)
        return {**keys, "mission": {k: v for k, v in keys["mission"].items() if k != "seed"}}

    def text(self) -> str:
        """Write it as a file."""
        return json.dumps(self.keys(), indent=2) + "\n"


def read_scenario(path: Path) -> Scenario:
    """Read a file of a scenario; MissionError names file and key of what is wrong."""
    try:
        return Scenario.model_validate(read_yaml(path, "a scenario is a block of keys"))
    except ValidationError as error:
        detail = first_mistake(error)
        keys = [*map(str, detail["loc"]), str(detail.get("ctx", {}).get("key", ""))]
        raise MissionError(path, ".".join(filter(None, keys)), in_words(detail, _unknown)) from None


def _unknown(loc: Sequence[int | str]) -> str:
    return unknown_key(
        str(loc[-1]), ({name: name for name in Scenario.model_fields},), Scenario.model_fields
    )
