"""What all sections of a world file have in common."""

from __future__ import annotations

import difflib
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Point = tuple[Number, Number]
Extent = tuple[Positive, Positive]


class Section(BaseModel):
    """Keys that are known, and never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _name_the_nearest_key(cls, data: Any) -> Any:
        """Refuse an unknown key, before anything else is wrong with it."""
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                near = difflib.get_close_matches(str(key), cls.model_fields, n=1, cutoff=0.5)
                raise PydanticCustomError(
                    "unknown_key",
                    "unknown key; did you mean {near}?" if near else "unknown key; known: {near}",
                    {"key": str(key), "near": near[0] if near else ", ".join(cls.model_fields)},
                )
        return data
