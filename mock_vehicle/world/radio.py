"""The section `radio` of a world file; docs/radio.md has the models and their sources."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from mock_vehicle.world.section import Fraction, NotNegative, Number, Point, Positive, Section

Wait = Annotated[Number, Field(ge=0, le=60)]
"""Seconds for which a frame or a fix is held, which bounds how many are."""
Sysid = Annotated[int, Field(strict=True, ge=1, le=255)]


class SectorSpec(Section):
    """Directions around a vehicle, clockwise from one to the other."""

    from_deg: Number
    """Where it begins, degrees clockwise from the nose."""
    to_deg: Number
    """Where it ends, degrees clockwise from the nose."""


class RangingSpec(Section):
    """How well the radio measures range and bearing of whom it hears."""

    range_noise_m: NotNegative = 0.0
    """Standard deviation of a range, m."""
    range_bias_m: NotNegative = 0.0
    """Standard deviation, from pair to pair, of an error that stays for the run, m."""
    outlier_fraction: Fraction = 0.0
    """Share of ranges over a detour, as without line of sight."""
    outlier_m: Positive = 1.0
    """Mean length of the detour, m; exponentially distributed."""
    bearing_noise_deg: NotNegative = 0.0
    """Standard deviation of a bearing, degrees."""
    bearing_bias_deg: NotNegative = 0.0
    """Standard deviation, from pair to pair, of an error that stays for the run, degrees."""
    blind: tuple[SectorSpec, ...] = ()
    """Sectors of the body, by azimuth, in which nobody is measured."""
    delay_s: Wait = 0.0
    """Time from measuring to telling, s."""


class DividerSpec(Section):
    """A straight line, without ends, that no frame crosses."""

    from_m: Point
    """One point x, y of it, m."""
    to_m: Point
    """Another, m."""


class PartitionSpec(Section):
    """A time in which the swarm falls apart."""

    from_s: NotNegative
    """When it begins, mission time, s."""
    until_s: Positive | None = None
    """When it ends, mission time, s; null: never."""
    groups: tuple[tuple[Sysid, ...], ...] = ()
    """sysids that hear only their own group; whom none names are one more group."""
    line: DividerSpec | None = None
    """In place of groups: a line whose two sides do not hear each other."""

    @model_validator(mode="after")
    def _divide(self) -> Self:
        if bool(self.groups) == (self.line is not None):
            raise PydanticCustomError("partition", "should have either groups or line")
        if self.until_s is not None and self.until_s <= self.from_s:
            raise PydanticCustomError("partition", "should have until_s after from_s")
        named = [sysid for group in self.groups for sysid in group]
        if len(named) != len(set(named)):
            raise PydanticCustomError("partition", "should have no sysid in groups twice")
        return self


class PathLossSpec(Section):
    """What weakens a signal on its way, and by how much; `radius_m` is the range in the open."""

    exponent: Positive = 2.0
    """Exponent of the log-distance law; 2 in free space, larger ends sooner behind a wall."""
    wall_db: NotNegative = 5.0
    """Attenuation by each solid in the line of sight, dB."""
    shadowing_db: NotNegative = 0.0
    """Standard deviation of the log-normal shadowing of a link, dB."""
    shadowing_m: Positive = 5.0
    """Way flown by the two together over which the shadowing's correlation falls to 1/e, m."""
    shadowing_s: Positive | None = None
    """Time over which it does so with both at rest, s; null: never."""


class ChannelSpec(Section):
    """One frequency that all share: who hears somebody send waits, and two at once spoil both."""

    bit_rate_bit_s: Positive = 250_000.0
    """Bits of frames carried in a second, bit/s."""
    slot_s: Positive = 0.00032
    """Time in which a start of sending is not yet heard by others, s; back-off counts in it."""
    window_slots: Annotated[int, Field(strict=True, ge=1)] = 32
    """Back-off is 0 to this many slots, less one; larger collides less and waits longer."""
    queue_frames: Annotated[int, Field(strict=True, ge=1)] = 20
    """Frames that wait in a radio at most; what comes then is lost."""


def _measures(value: Any) -> Any:
    """Read `ranging: true` as without errors, and `ranging: false` as none."""
    return {True: {}, False: None}[value] if isinstance(value, bool) else value


class RadioSpec(Section):
    """The telemetry radio between vehicles; as it comes, an ideal disc."""

    radius_m: NotNegative = 2.0
    """Range, m."""
    delay_s: Wait = 0.0
    """Time from sending to hearing, s."""
    jitter_s: Wait = 0.0
    """Up to so much more, evenly, for each hearer, s."""
    loss_fraction: Fraction = 0.0
    """Share of frames that get lost."""
    duplicate_fraction: Fraction = 0.0
    """Share of frames that are heard twice."""
    reorder_fraction: Fraction = 0.0
    """Share of frames that are held back, so that later ones overtake them."""
    reorder_hold_s: Wait = 0.2
    """For how long they are held back, s."""
    path_loss: PathLossSpec | None = None
    """Walls and shadowing; null: the range is the same everywhere."""
    channel: ChannelSpec | None = None
    """What frames share; null: there is room for all at once."""
    partitions: tuple[PartitionSpec, ...] = ()
    """When the swarm falls apart, and how."""
    ranging: Annotated[
        RangingSpec | None, BeforeValidator(_measures, json_schema_input_type=RangingSpec | bool)
    ] = RangingSpec()
    """How well it also measures range and bearing of whom it hears; false: not at all."""
