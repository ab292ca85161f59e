"""World files: the models that a floor plan in YAML must satisfy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, PlainValidator, Tag, WithJsonSchema
from pydantic_core import PydanticCustomError

from mock_vehicle.faults import Fault, FaultError, read_fault
from mock_vehicle.faults.describe import schema
from mock_vehicle.geodesy import TESTING_GROUND
from mock_vehicle.world.radio import RadioSpec
from mock_vehicle.world.section import (
    Extent,
    NotNegative,
    Number,
    Point,
    Positive,
    Section,
)


class MapSpec(Section):
    """A ROS map_server map as walls, in place of `size_m` and the outer walls."""

    file: Path
    """The map's YAML file, relative to the world file."""
    height_m: Positive | None = None
    """Height of its walls above the floor, m; default: to the ceiling, 3 m under open sky."""


class _Solid(Section):
    """What stands upright."""

    bottom_m: NotNegative = 0.0
    """Height of its lower face, m."""
    height_m: Positive | None = None
    """Height from bottom to top, m; default: to the ceiling, 3 m under open sky."""


class BoxSpec(_Solid):
    """An upright box."""

    center_m: Point
    """Centre x, y, m."""
    size_m: Extent
    """Edges along its own x and y, m."""
    yaw_deg: Number = 0.0
    """Its x axis, degrees counter-clockwise from east."""


class DoorSpec(Section):
    """A gap in a wall."""

    at_m: NotNegative
    """Its middle, m along the wall from `from_m`."""
    width_m: Positive
    """Clear width, m."""
    height_m: Positive | None = None
    """Height of the lintel above the wall's bottom, m; null: the gap has the wall's height."""


class WallSpec(_Solid):
    """A straight wall with doors."""

    from_m: Point
    """One end x, y of its middle line, m."""
    to_m: Point
    """The other end, m."""
    thickness_m: Positive = 0.1
    """Thickness, half of it on either side of the line, m."""
    doors: tuple[DoorSpec, ...] = ()
    """Gaps, which may not overlap."""


class CylinderSpec(_Solid):
    """An upright cylinder."""

    center_m: Point
    """Axis x, y, m."""
    radius_m: Positive
    """Radius, m."""


class VictimSpec(Section):
    """Somebody to find."""

    name: Annotated[str, Field(min_length=1)]
    """Unique name."""
    position_m: tuple[Number, Number, NotNegative]
    """x, y, z, m."""


class StartSpec(Section):
    """The place of one vehicle on the floor."""

    position_m: Point
    """x, y, m."""
    yaw_deg: Number = 90.0
    """Direction of its nose, degrees counter-clockwise from east; 90 is north."""


class GridSpec(Section):
    """Rows from west to east, the next row to the north."""

    origin_m: Point
    """x, y of the first vehicle, m."""
    spacing_m: Positive = 1.5
    """Distance between neighbours, m."""
    columns: Annotated[int, Field(strict=True, ge=1)] = 5
    """Vehicles in a row."""
    yaw_deg: Number = 90.0
    """Direction of all noses, degrees counter-clockwise from east."""


class RandomSpec(Section):
    """Anywhere on free floor, noses anywhere, both drawn from the run's seed."""

    margin_m: NotNegative = 1.0
    """Least distance to anything solid, m; larger keeps starts away from walls."""
    spacing_m: NotNegative = 1.5
    """Least distance between two vehicles, m."""


class GridStarts(Section):
    """Starts in rows."""

    grid: GridSpec
    """The rows."""


class RandomStarts(Section):
    """Starts by chance."""

    random: RandomSpec
    """The rule of chance."""


def _kind_of_starts(value: Any) -> str | None:
    if isinstance(value, list | tuple):
        return "list"
    if isinstance(value, GridStarts | RandomStarts):
        return "grid" if isinstance(value, GridStarts) else "random"
    return next((k for k in ("grid", "random") if isinstance(value, dict) and k in value), None)


Starts = Annotated[
    Annotated[tuple[StartSpec, ...], Tag("list")]
    | Annotated[GridStarts, Tag("grid")]
    | Annotated[RandomStarts, Tag("random")],
    Discriminator(
        _kind_of_starts,
        custom_error_type="starts",
        custom_error_message="should be a list of positions, {grid: ...} or {random: ...}",
    ),
]


class CoverageSpec(Section):
    """How the referee counts space as seen."""

    footprint: Literal["square", "disc", "sphere"] = "disc"
    """What a vehicle sees around itself: floor cells of a square or a disc, or cells of space."""
    radius_m: Positive = 1.0
    """Radius, or half the side of the square, m."""
    cell_m: Positive = 0.1
    """Edge of a cell, m; smaller counts finer and slower."""
    line_of_sight: bool = True
    """Whether walls hide what is behind them."""


class InfraredSpec(Section):
    """The sensor that sees victims."""

    range_m: NotNegative = 2.0
    """Range, m."""


class WindSpec(Section):
    """The wind."""

    from_deg: Number = 0.0
    """Where it comes from, degrees counter-clockwise from east."""
    speed_m_s: NotNegative = 0.0
    """Mean speed, m/s."""
    gust_m_s: NotNegative = 0.0
    """Standard deviation of the gusts, m/s."""


class SensorsSpec(Section):
    """Ranges and errors of rangefinders and odometry."""

    range_max_m: Positive = 8.0
    """Farthest distance of the rangefinders, m."""
    range_noise_m: NotNegative = 0.0
    """Standard deviation of the rangefinders, m."""
    odometry_drift_fraction: NotNegative = 0.0
    """Drift of the position estimate per distance flown."""


class GnssSpec(Section):
    """Where the world lies on the globe, and how well satellites are received there."""

    latitude_deg: Annotated[Number, Field(ge=-85, le=85)] = TESTING_GROUND.latitude_deg
    """Latitude of x = y = 0, degrees."""
    longitude_deg: Annotated[Number, Field(ge=-180, le=180)] = TESTING_GROUND.longitude_deg
    """Longitude of x = y = 0, degrees."""
    amsl_m: Number = TESTING_GROUND.amsl_m
    """Altitude of the floor above mean sea level, m."""
    reception: Literal["present", "degraded", "denied"] = "present"
    """Whether there is a fix, a bad one, or none, as indoors."""


def _fault(keys: Any) -> Fault:
    try:
        return read_fault(keys)
    except FaultError as error:
        about = {"key": error.key, "reason": error.reason}
        raise PydanticCustomError("fault", "{reason}", about) from None


FaultSpec = Annotated[Fault, PlainValidator(_fault), WithJsonSchema(schema())]
"""Something that breaks during the run; `mock_vehicle.faults` knows what can."""


class FaultsSpec(Section):
    """A file of faults alone."""

    faults: tuple[FaultSpec, ...] = ()
    """What breaks, as in a world file."""


class WorldSpec(Section):
    """A world file: x east, y north, z up, metres, degrees counter-clockwise from east."""

    name: Annotated[str, Field(min_length=1)]
    """Short name."""
    size_m: Extent | None = None
    """Extent in x and y, m; required without a map."""
    origin_m: Point = (0.0, 0.0)
    """Lower-left corner, m."""
    closed: bool = True
    """Whether solid outer walls stand around the extent."""
    ceiling_m: Positive | None = None
    """Height of the ceiling, m; null: open sky."""
    map: MapSpec | None = None
    """A ROS map in place of `size_m`."""
    boxes: tuple[BoxSpec, ...] = ()
    """Furniture, pillars, rubble."""
    walls: tuple[WallSpec, ...] = ()
    """Inner walls."""
    cylinders: tuple[CylinderSpec, ...] = ()
    """Columns, trees."""
    victims: tuple[VictimSpec, ...] = ()
    """Whom to find."""
    starts: Starts = RandomStarts(random=RandomSpec())
    """Where the vehicles stand at the beginning."""
    coverage: CoverageSpec = CoverageSpec()
    """How the referee counts."""
    radio: RadioSpec = RadioSpec()
    """The radio."""
    infrared: InfraredSpec = InfraredSpec()
    """The infrared sensor."""
    wind: WindSpec = WindSpec()
    """The wind."""
    sensors: SensorsSpec = SensorsSpec()
    """The other sensors."""
    gnss: GnssSpec = GnssSpec()
    """Place on the globe, and satellites."""
    faults: tuple[FaultSpec, ...] = ()
    """What breaks."""
