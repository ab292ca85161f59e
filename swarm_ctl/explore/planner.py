"""LF-PSO and its two baselines: where each vehicle flies next, for one vehicle or for thousands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from swarm_ctl.errors import SwarmError
from swarm_ctl.explore.avoidance import RANGE_ORDER, Avoidance, StallWatch
from swarm_ctl.explore.chance import Chance, Floats, Rows, Seed
from swarm_ctl.explore.levy import Walk, even_length, levy_length
from swarm_ctl.explore.own import OWN, find_planner
from swarm_ctl.explore.repulsion import Repulsion
from swarm_ctl.explore.rows import NUMPY, Kernels

__all__ = ["RANGE_ORDER", "Plan", "Planner", "PlannerParams"]

SLOW = 0.05
"""Fraction of the planner's speed below which the direction of travel says nothing."""


EXPLORE: dict[str, Any] = {"social": 0.1, "keep_repulsion": False, "repulsion_max": 2.0}
"""Defaults of kind `explore` that differ (ALGORITHM 2.6: F3)."""
EXPLORE_WIDTHS = {"levy_min_m": 2.0 / 0.6, "levy_max_m": 5.0 / 0.6}
"""The same, in widths of the footprint."""
EXPLORE_3D: dict[str, Any] = {
    **EXPLORE,
    "social": 0.5,
    "candidates": 24,
    "adjacency": 0.0,
    "abort_below": 4.0,
    "clearance_m": 0.5,
    "footprint_m": 1.0,
    "footprint_shape": "disc",
}
"""Defaults of kind `explore` in 3-D (ALGORITHM 3.3)."""
EXPLORE_3D_WIDTHS = {"levy_min_m": 0.5, "levy_max_m": 3.0, "cell_m": 0.25}
"""The same, in widths of the footprint."""


KINDS = ("lf-pso", "levy", "pso", "explore")
"""Planners that come with the package."""
_KIND_SCHEMA = {"anyOf": [{"enum": list(KINDS)}, {"type": "string", "pattern": f"^{OWN.pattern}$"}]}


def _known(kind: str) -> str:
    """Refuse a kind of planner that is neither ours nor can be imported."""
    if OWN.fullmatch(kind):
        find_planner(kind)
    elif kind not in KINDS:
        expected = f"{', '.join(map(repr, KINDS))} or your own as module:Class"
        raise PydanticCustomError("literal_error", "must be {expected}", {"expected": expected})
    return kind


class PlannerParams(BaseModel):
    """What the paper leaves open or sets in its experiments; lengths in metres.

    The batch that reproduces the paper takes the defaults with `period_s` 1, a speed of 0.2 m/s
    and `avoid_speed_fraction` 1.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False
    )

    kind: Annotated[str, AfterValidator(_known), WithJsonSchema(_KIND_SCHEMA)] = "lf-pso"
    """The hybrid, or its baselines: `levy` has no social term, `pso` no Levy steps.

    "For comparison, we selected the traditional PSO, and LF." `explore` is the hybrid with a
    memory that vehicles share (LF-PSO-M); it has defaults of its own, see `EXPLORE`.
    `module:Class` is a planner of your own, see docs/planners.md.
    """
    dimensions: Literal[2, 3] = 2
    """2: height is nobody's business here. 3: steps and repulsion climb and descend, too."""
    period_s: float = Field(default=0.3, gt=0.0)
    """Time between planner steps, s. The paper: "equivalent to a one-second timestep".

    Longer: more path per draw of Eq. 6, and obstacles are noticed later.
    """
    inertia: float = Field(default=0.6, ge=0.0, lt=1.0)
    """omega of Eq. 6. Larger: straighter paths, slower answers."""
    cognitive: float = Field(default=2.0, ge=0.0)
    """p_omega of Eq. 6, the pull of the local best. Larger: closer to the Levy step."""
    social: float = Field(default=2.0, ge=0.0)
    """n_omega of Eq. 6, the pull of the global best. Larger: the swarm spreads more eagerly."""
    levy_min_m: float = Field(default=0.03, gt=0.0)
    """Shortest Levy step, m. Larger: longer straight lines. UAVs want about 3 footprints."""
    levy_max_m: float = Field(default=20.0, gt=0.0)
    """Longest Levy step, m; longer draws are cut. Larger: rare crossings of the whole area."""
    levy_beta: float = Field(default=1.0, ge=0.1, le=3.0)
    """Exponent of the tail, P(s > x) ~ x^-beta. Larger: long steps are rarer.

    "The beta term for LF was set to 1."
    """
    climb_angle_deg: float = Field(default=30.0, ge=0.0, le=90.0)
    """Steepest Levy step in 3-D, degrees from level. Larger: more climbing, less travel."""
    keep_repulsion: bool = True
    """Whether the last global best stands while no peer is in range.

    The paper says both: "the global repulsive force is updated when a robot approaches other
    robots" (kept; this gives its figures) and "this repulsion factor becomes null in the absence
    of other robots within its communication range" (not kept: 12 to 15 points less coverage).
    """
    repulsion_max: float | None = Field(default=None, gt=0.0)
    """Largest D of Eq. 3, m; none: only 1/d with d of at least 0.1 m bounds it. Larger: close
    neighbours outweigh the Levy step for longer. UAVs in 3-D: 2."""
    repulsion_vertical: float = Field(default=1.0, ge=0.0)
    """Weight w_z of the down component in 3-D. Larger: vehicles part rather in height."""
    pso_step_max_m: float = Field(default=1.25, gt=0.0)
    """Longest step of kind `pso`, m, drawn evenly from 0. Larger: straighter paths."""
    avoid_distance_m: float = Field(default=0.9, gt=0.0)
    """Range that triggers a sensor of Table I, m; must exceed the wall stand-off of the safety
    filter. Larger: turns earlier and leaves wider margins unexplored."""
    avoid_speed_fraction: float = Field(default=0.7, gt=0.0, le=1.0)
    """Speed along the turned heading, as a fraction of the speed. Larger: clears sooner."""
    avoid_climb_fraction: float = Field(default=0.5, gt=0.0, le=1.0)
    """Climb or descent that Table I commands, as a fraction of the climb speed."""
    stall_distance_m: float = Field(default=0.2, gt=0.0)
    """Path below which a vehicle that was sent more than twice as far counts as stalled, m.
    Larger: gives up on slower progress."""
    stall_time_s: float = Field(default=1.0, gt=0.0)
    """Window of that path, s, rounded up to planner steps. Larger: waits longer."""

    footprint_m: float = Field(default=0.3, gt=0.0)
    """Half the width of what counts as seen (`explore`), m. Larger: lanes farther apart.

    "The robot's size was considered as 0.6 * 0.6m, and the area covered by a robot based on its
    size was treated as explored."
    """
    footprint_shape: Literal["square", "disc"] = "square"
    """The paper's square along the axes, or a disc; in 3-D always a sphere."""
    cell_m: float = Field(default=0.2, gt=0.0)
    """Edge of a cell of the memory, m. Larger: quicker, and narrow doors close."""
    clearance_m: float = Field(default=0.3, gt=0.0)
    """Half the width that a straight step needs between walls, m. Larger: keeps off corners."""
    standoff_m: float = Field(default=0.2, ge=0.0)
    """Distance from a wall at which a step towards it ends, m. Larger: turns earlier."""
    wall_dilation_cells: int = Field(default=1, ge=0)
    """Cells around a wall that no path to a frontier enters. Larger: narrow doors close."""
    candidates: int = Field(default=16, ge=1, le=64)
    """Steps among which a decision chooses. Larger: greedier."""
    adjacency: float = Field(default=1.0, ge=0.0)
    """Worth of new ground beside known ground, as much again. Larger: tidier sweeps."""
    abort_below: float = Field(default=2.0, ge=0.0)
    """New samples in the strip ahead below which a step ends early. Larger: ends earlier."""
    frontier_below: float = Field(default=0.1, ge=0.0)
    """Share of new ground below which a step is not worth it and a frontier is sought."""
    target_exclusion_m: float = Field(default=5.0, ge=0.0)
    """Frontiers closer than this to a peer's target are left to it, m."""
    peer_weight: float = Field(default=0.3, ge=0.0)
    """Malus of a step towards a peer's last position or target. Larger: spreads more."""
    memory_s: float = Field(default=60.0, gt=0.0)
    """Time in which a sighting of a peer fades to 1/e, s. Larger: keeps away for longer."""

    @model_validator(mode="before")
    @classmethod
    def _explore_defaults(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("kind") != "explore":
            return data
        is_flat = data.get("dimensions", 2) != 3
        defaults = {"footprint_m": 0.3, **(EXPLORE if is_flat else EXPLORE_3D), **data}
        if not isinstance(defaults["footprint_m"], int | float):
            return data  # the field itself says what is wrong with it
        widths = EXPLORE_WIDTHS if is_flat else EXPLORE_3D_WIDTHS
        scaled = {name: 2.0 * defaults["footprint_m"] * width for name, width in widths.items()}
        return {**scaled, **defaults}

    @model_validator(mode="after")
    def _order_lengths(self) -> Self:
        if self.levy_min_m > self.levy_max_m:
            sentence = f"must be at most levy_max_m ({self.levy_max_m:g}), not {self.levy_min_m:g}"
            about = {"key": "planner.levy_min_m", "reason": sentence}
            raise PydanticCustomError("cross_check", "{reason}", about)
        return self


class Plan(NamedTuple):
    """What each vehicle should do until the next planner step, in its own local NED."""

    velocity_m_s: Floats
    """(n, d), within the planner's speed and climb."""
    heading_rad: Floats
    """(n,) direction of travel to face, clockwise from north; the last one when slow."""
    avoiding: NDArray[np.bool_]
    """(n,) whether Table I rules, along the ground or in height."""
    target_m: Floats
    """(n, d) local best P_lb; it keeps its distance until the step's length has been flown."""
    is_new: NDArray[np.bool_]
    """(n,) whether the local best was chosen anew or turned in this step."""


class OnePlan(NamedTuple):
    """A `Plan` of one vehicle, in plain numbers."""

    velocity_m_s: list[float]
    """d of them."""
    heading_rad: float
    is_avoiding: bool
    target_m: list[float]
    """d of them."""
    is_new: bool


class Planning(Protocol):
    """What is asked of every planner, also of one that is not ours."""

    def step(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats
    ) -> Plan:
        """Plan once per period, as `Planner.step` does."""


class Planner:
    """Plan for n vehicles that know only their own frame, ranges and peers; n = len(seeds).

    The vehicles share nothing: row i of every answer depends on row i of every question, on
    `seeds[i]` and on nothing else, so that one vehicle alone flies as it does in a batch.
    """

    def __init__(
        self,
        params: PlannerParams,
        *,
        speed_m_s: float,
        climb_m_s: float,
        seeds: Sequence[Seed],
        kernels: Kernels = NUMPY,
    ) -> None:
        if params.kind == "explore":
            raise ValueError("kind explore is an Explorer: use one.make_planner")
        if speed_m_s <= 0.0 or (params.dimensions == 3 and climb_m_s <= 0.0):
            raise ValueError("speed and, in 3-D, climb must be positive")
        n, d = len(seeds), params.dimensions
        self.params = params
        self._shape = (n, d)
        self._level_m = speed_m_s * params.period_s
        self._climb_m = climb_m_s * params.period_s
        is_social = params.kind != "levy" and params.social > 0.0
        self._weights = (params.inertia, params.cognitive, params.social if is_social else 0.0)
        self._rows: Rows = np.arange(n, dtype=np.intp)
        self._kernels = kernels = kernels if d == 2 else NUMPY
        self._chance = Chance(seeds, kernels.short, kernels.deal)
        self._walk = _walk(params, self._chance, self._rows, kernels)
        self._repulsion = Repulsion(
            n,
            d,
            kept=params.keep_repulsion and params.kind == "lf-pso",
            vertical=params.repulsion_vertical,
            longest_m=params.repulsion_max,
            hear=kernels.hear,
        )
        self._avoidance = Avoidance(n, params.avoid_distance_m, d, kernels.consult)
        window = math.ceil(params.stall_time_s / params.period_s - 1e-9)
        self._stall = StallWatch(n, window, params.stall_distance_m)
        self._motion_m: Floats = np.zeros((n, d))
        self._ground_m: Floats = np.zeros(n)
        self._position_m: Floats | None = None
        self._facing_rad: Floats = np.zeros(n)

    def step(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats
    ) -> Plan:
        """Plan once per period from (n, d), (n,), (n, 6) and (n, k, d); ValueError for others.

        Ranges come in RANGE_ORDER, `inf` where nothing is. Peers are offsets, peer minus own, of
        the members of the vehicle's cluster that it knows of, padded with NaN.
        """
        self._check(position_m, heading_rad, ranges_m, peers_m)
        self._account(position_m, heading_rad)
        free = self._avoidance.update(heading_rad, ranges_m, self._chance)
        if free.size:
            self._walk.face(free, self._avoidance.heading_rad[free])
        if self._weights[2]:
            self._repulsion.update(peers_m)
        self._motion_m, self._ground_m = self._fly()
        avoiding = self._avoidance.is_active
        if avoiding.any():
            self._avoid()
        self._face()
        is_new, self._walk.is_new = self._walk.is_new, np.zeros(len(self._rows), dtype=np.bool_)
        return Plan(
            self._motion_m / self.params.period_s,
            self._facing_rad,
            avoiding,
            position_m + self._walk.vector_m,
            is_new,
        )

    def _check(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats
    ) -> None:
        n, d = self._shape
        if (
            position_m.shape != (n, d)
            or heading_rad.shape != (n,)
            or ranges_m.shape != (n, len(RANGE_ORDER))
            or peers_m.shape != (n, peers_m.shape[1], d)
        ):
            raise ValueError(f"expected arrays for {n} vehicles in {d}-D")

    def _account(self, position_m: Floats, heading_rad: Floats) -> None:
        """Count the path since the last step; "once the robot has traversed" its step, renew it.

        Path flown while Eq. 6 is suspended does not count.
        """
        last_m, self._position_m = self._position_m, position_m.copy()
        if last_m is None:
            self._facing_rad = heading_rad.copy()
            return
        moved_m, flown_m = self._kernels.travel(last_m, position_m, self._avoidance.suspends)
        stalled = self._stall.update(moved_m, self._ground_m)
        self._walk.advance(flown_m)
        if stalled.size:
            self._escape(stalled)

    def _escape(self, rows: Rows) -> None:
        """Send stalled vehicles into the half space away from where they could not go."""
        blocked = self._motion_m[rows]
        self._walk.leave(rows, blocked)
        self._repulsion.release(rows, blocked)
        self._avoidance.reset(rows)
        self._motion_m[rows] = 0.0

    def _fly(self) -> tuple[Floats, Floats]:
        """Move by Eq. 6: `rand` is one number per term and axis in 2-D, per term in 3-D."""
        terms = self._shape[1] if self._shape[1] == 2 else 1
        return self._kernels.fly(
            self._motion_m,
            self._walk.vector_m,
            self._repulsion.vector_m,
            self._chance.uniform(self._rows, 2 * terms),
            self._weights,
            self._level_m,
            self._climb_m,
        )

    def _avoid(self) -> None:
        """Put Table I in the place of Eq. 6 where sensors are triggered."""
        turning = self._avoidance.suspends.nonzero()[0]
        heading_rad = self._avoidance.heading_rad[turning]
        level_m = self._level_m * self.params.avoid_speed_fraction
        self._motion_m[:, 0][turning] = level_m * np.cos(heading_rad)
        self._motion_m[:, 1][turning] = level_m * np.sin(heading_rad)
        self._ground_m[turning] = level_m
        if self._shape[1] == 3:
            self._avoid_vertically()

    def _avoid_vertically(self) -> None:
        rules, down = self._avoidance.vertical
        rows = rules.nonzero()[0]
        self._motion_m[rows, 2] = down[rows] * self._climb_m * self.params.avoid_climb_fraction
        away = down.nonzero()[0]
        self._walk.bounce(away, down[away])

    def _face(self) -> None:
        travel_rad = np.arctan2(self._motion_m[:, 1], self._motion_m[:, 0])
        fast = self._ground_m > SLOW * self._level_m
        self._facing_rad = np.where(fast, travel_rad, self._facing_rad)


def plan_with(
    params: PlannerParams,
    *,
    speed_m_s: float,
    climb_m_s: float,
    seeds: Sequence[Seed],
    kernels: Kernels = NUMPY,
) -> Planning:
    """Build a planner without a memory: ours, or the one that `kind` names."""
    if OWN.fullmatch(params.kind) is None:
        return Planner(
            params, speed_m_s=speed_m_s, climb_m_s=climb_m_s, seeds=seeds, kernels=kernels
        )
    try:
        own: Planning = find_planner(params.kind)(
            params, speed_m_s=speed_m_s, climb_m_s=climb_m_s, seeds=seeds
        )
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise SwarmError(f"planner.kind: {params.kind} could not be built: {reason}") from error
    return own


def _walk(params: PlannerParams, chance: Chance, rows: Rows, kernels: Kernels) -> Walk:
    if params.kind == "pso":
        length_m = partial(even_length, longest_m=params.pso_step_max_m)
    else:
        length_m = partial(
            levy_length,
            shortest_m=params.levy_min_m,
            longest_m=params.levy_max_m,
            beta=params.levy_beta,
        )
    steepest = math.sin(math.radians(params.climb_angle_deg))
    return Walk(chance, rows, params.dimensions, length_m, steepest, kernels.put)
