"""What a seed stands for: a mission, its world and its troubles, drawn so that it can be flown.

What is drawn is possible: vehicles start apart, doors are wide enough, radios reach as far as two
vehicles need to stop (docs/safety.md). What goes wrong after that may go wrong in any combination.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from swarm_ctl.experiment.soak.scenario import Scenario

SWARMS = {1: 5, 2: 30, 3: 30, 4: 20, 5: 10, 8: 3, 12: 1, 20: 1}
"""Vehicles, and how often in a hundred."""
WALL_M = 0.5
WALL_ROOM_M = 1.0
"""From a start to whatever stands around: a vehicle rises there whatever the wind does."""
START_ROOM_M = 1.6
LOW_M, LEAST_HEIGHT_M = 0.4, 1.1
"""Furniture that is flown over, and the least height of who does."""
LEAST_M2, VEHICLE_M2 = 36.0, 10.0
"""Floor of a hall, and for each vehicle: in less, nobody could fly at all."""

Keys = dict[str, Any]
Choice = TypeVar("Choice")


class Dice:
    """Draws of one seed, each rounded so that a file of them is fit to read."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 6])

    def number(self, low: float, high: float, digits: int = 2) -> float:
        """Draw evenly."""
        return round(float(self._rng.uniform(low, high)), digits)

    def whole(self, low: int, high: int) -> int:
        """Draw a whole number, the higher one included."""
        return int(self._rng.integers(low, high + 1))

    def hits(self, share: float) -> bool:
        """Say yes in a share of all cases."""
        return bool(self._rng.random() < share)

    def pick(self, options: Mapping[Choice, float]) -> Choice:
        """Draw one of several by their weights."""
        weights = np.array(list(options.values()), dtype=float)
        return list(options)[int(self._rng.choice(len(weights), p=weights / weights.sum()))]


def draw(seed: int) -> Scenario:
    """Draw the scenario of a seed; the same one on every machine."""
    dice = Dice(seed)
    is_deep = dice.hits(0.3)
    world, starts_m = _hall(dice, dice.pick(SWARMS), is_deep=is_deep)
    vehicles = len(starts_m)
    mission = _mission(dice, world, starts_m, is_deep=is_deep)
    world |= _air(dice, mission)
    end_s = 12.0 + mission["duration_s"]
    faults = [_fault(dice, vehicles, end_s) for _ in range(dice.pick({0: 25, 1: 35, 2: 25, 4: 15}))]
    orders = _orders(dice, vehicles, end_s) if dice.hits(0.25) else []
    takeovers = _takeovers(dice, vehicles, end_s) if dice.hits(0.15) else []
    return Scenario.model_validate(
        {
            "seed": seed,
            "mission": mission,
            "world": world,
            "faults": faults,
            "orders": orders,
            "takeovers": takeovers,
        }
    )


# The place.


def _hall(dice: Dice, vehicles: int, *, is_deep: bool) -> tuple[Keys, list[tuple[float, float]]]:
    """Draw a hall with walls and furniture, large enough for its vehicles; and their starts."""
    area_m2 = max(LEAST_M2, VEHICLE_M2 * vehicles) * dice.number(1.0, 1.8)
    east_m = round(math.sqrt(area_m2) * dice.number(0.8, 1.3), 1)
    size = (east_m, round(area_m2 / east_m, 1))
    walls, lines = _walls(dice, size)
    boxes, cylinders, discs = _furniture(dice, size, lines, is_deep=is_deep)
    taken = _Taken(size, lines, discs)
    starts_m = taken.places(dice, vehicles, START_ROOM_M, WALL_ROOM_M)
    victims = _Taken(size, lines, discs).places(dice, dice.whole(0, 4), 0.5, 0.4)
    world = {
        "name": "drawn",
        "size_m": list(size),
        "ceiling_m": dice.number(3.2, 6.0, 1) if is_deep else dice.number(2.6, 4.0, 1),
        "walls": walls,
        "boxes": boxes,
        "cylinders": cylinders,
        "victims": [
            {"name": f"v{number}", "position_m": [*place, 0.3]}
            for number, place in enumerate(victims, start=1)
        ],
        "starts": [
            {"position_m": list(place), "yaw_deg": dice.number(-180.0, 180.0, 0)}
            for place in starts_m
        ],
        "coverage": {"radius_m": 1.0, "cell_m": 0.5},
    }
    return world, starts_m


def _walls(dice: Dice, size: tuple[float, float]) -> tuple[list[Keys], list[tuple[int, float]]]:
    """Draw walls across the hall, none near another, each with doors; and (axis, where) of each."""
    walls: list[Keys] = []
    lines: list[tuple[int, float]] = []
    for _ in range(dice.pick({0: 35, 1: 40, 2: 25})):
        axis = dice.whole(0, 1)
        length_m, across_m = size[1 - axis], size[axis]
        if across_m < 6.0 or length_m < 5.0 or any(known == axis for known, _ in lines):
            continue
        at_m = dice.number(0.4 * across_m, 0.6 * across_m, 1)
        ends = [[at_m, 0.0], [at_m, length_m]] if axis == 0 else [[0.0, at_m], [length_m, at_m]]
        width_m = dice.number(1.6, 2.2, 1)
        thirds = [length_m / 4.0, 3.0 * length_m / 4.0][: dice.whole(1, 2)]
        doors = [{"at_m": round(third, 1), "width_m": width_m} for third in thirds]
        walls.append({"from_m": ends[0], "to_m": ends[1], "thickness_m": 0.2, "doors": doors})
        lines.append((axis, at_m))
    return walls, lines


def _furniture(
    dice: Dice, size: tuple[float, float], lines: Sequence[tuple[int, float]], *, is_deep: bool
) -> tuple[list[Keys], list[Keys], list[tuple[float, float, float]]]:
    """Draw boxes and pillars; and a disc (x, y, radius) around each.

    They reach the ceiling, or end well below who flies on one level: the beams of a rangefinder
    pass over an edge that a body would still touch.
    """
    boxes, cylinders, discs = [], [], []
    for x, y in _Taken(size, lines, []).places(dice, dice.whole(0, 3), 2.0, 1.6):
        if dice.hits(0.5):
            edges = [dice.number(0.4, 1.6, 1), dice.number(0.4, 1.6, 1)]
            box: Keys = {"center_m": [x, y], "size_m": edges, "yaw_deg": dice.number(0.0, 90.0, 0)}
            boxes.append(box | ({"height_m": LOW_M} if dice.hits(0.4) and not is_deep else {}))
            discs.append((x, y, math.hypot(*edges) / 2.0))
        else:
            radius_m = dice.number(0.15, 0.6)
            cylinders.append({"center_m": [x, y], "radius_m": radius_m})
            discs.append((x, y, radius_m))
    return boxes, cylinders, discs


class _Taken:
    """Which floor is left for somebody to stand on."""

    def __init__(
        self,
        size: tuple[float, float],
        lines: Sequence[tuple[int, float]],
        discs: Sequence[tuple[float, float, float]],
    ) -> None:
        self._size, self._lines, self._discs = size, lines, discs

    def places(
        self, dice: Dice, count: int, apart_m: float, room_m: float
    ) -> list[tuple[float, float]]:
        """Draw places so far apart, and from walls and furniture; fewer where there is no room."""
        kept: list[tuple[float, float]] = []
        for _ in range(200 * count):
            if len(kept) == count:
                break
            x, y = (dice.number(room_m, edge - room_m) for edge in self._size)
            if self._is_free((x, y), room_m) and all(
                math.dist((x, y), other) >= apart_m for other in kept
            ):
                kept.append((x, y))
        return kept

    def _is_free(self, place: tuple[float, float], room_m: float) -> bool:
        return all(abs(place[axis] - at_m) >= room_m + 0.1 for axis, at_m in self._lines) and all(
            math.dist(place, (x, y)) >= room_m + radius_m for x, y, radius_m in self._discs
        )


# The mission.


def _mission(
    dice: Dice, world: Keys, starts_m: Sequence[tuple[float, float]], *, is_deep: bool
) -> Keys:
    """Draw what the swarm is to do."""
    speed_m_s = dice.number(0.4, 1.4, 1)
    below_m = dice.number(0.5, 1.2 if is_deep else 0.7)
    limits: Keys = {"ceiling_m": round(world["ceiling_m"] - below_m, 2), "max_time_s": 200.0}
    limits |= {"floor_m": dice.number(0.4, 1.0) if is_deep else 0.4, "wall_m": WALL_M}
    limits["separation_m"] = dice.number(1.0, 1.3, 1)
    if dice.hits(0.15):
        limits["radius_m"] = dice.number(2.0, 6.0, 1)
    return {
        "vehicles": len(starts_m),
        "autopilot": dice.pick({"px4": 40, "ardupilot": 30, "mixed": 30}),
        "duration_s": dice.number(4.0, 16.0, 0),
        "planner": _planner(dice, is_deep=is_deep),
        "flight": {
            "height_m": dice.number(LEAST_HEIGHT_M, 1.6, 1),
            "speed_m_s": speed_m_s,
            "climb_m_s": dice.number(0.5, 1.0, 1),
            "return_home": dice.hits(0.6),
            "return_timeout_s": 40.0,
            "start_spacing_s": 0.0 if dice.hits(0.7) else dice.number(0.0, 2.0, 1),
        },
        "limits": limits,
        "frame": _frame(dice, starts_m),
    }


def _planner(dice: Dice, *, is_deep: bool) -> Keys:
    kind = dice.pick({"explore": 60, "lf-pso": 25, "levy": 10, "pso": 5})
    planner: Keys = {"kind": kind, "dimensions": 3 if is_deep else 2, "avoid_distance_m": 0.7}
    if kind != "explore":
        return planner | {"levy_min_m": dice.number(0.03, 2.0)}
    return planner | {"footprint_m": dice.number(0.6, 1.0, 1), "footprint_shape": "disc"}


def _frame(dice: Dice, starts_m: Sequence[tuple[float, float]]) -> Keys:
    shared = dice.pick({"none": 65, "surveyed": 20, "gnss": 15})
    if shared != "surveyed":
        return {"shared": shared}
    places = {sysid: [*place, 0.0] for sysid, place in enumerate(starts_m, start=1)}
    return {"shared": shared, "starts_m": places}


# The air: radio, sensors, wind.


def _air(dice: Dice, mission: Keys) -> Keys:
    return {
        "radio": _radio(dice, mission),
        "sensors": {
            "range_noise_m": dice.pick({0.0: 60, 0.02: 25, 0.05: 15}),
            "odometry_drift_fraction": dice.pick({0.0: 60, 0.005: 25, 0.02: 15}),
        },
        "wind": {
            "from_deg": dice.number(0.0, 360.0, 0),
            "speed_m_s": dice.pick({0.0: 60, 0.5: 20, 1.5: 20}),
            "gust_m_s": dice.pick({0.0: 60, 0.2: 25, 0.5: 15}),
        },
    }


def _radio(dice: Dice, mission: Keys) -> Keys:
    """Draw a radio that reaches as far as two vehicles need to stop (docs/safety.md), or more."""
    speed_m_s = mission["flight"]["speed_m_s"]
    least_m = mission["limits"]["separation_m"] + speed_m_s**2 + 2.0 * speed_m_s
    radio: Keys = {
        "radius_m": dice.number(least_m, least_m + 8.0, 1),
        "delay_s": dice.pick({0.0: 50, 0.1: 30, 0.2: 20}),
        "loss_fraction": dice.pick({0.0: 40, 0.1: 25, 0.3: 35}),
        "ranging": {
            "range_noise_m": dice.pick({0.0: 40, 0.05: 50, 0.1: 10}),
            "bearing_noise_deg": dice.pick({0.0: 50, 2.0: 30, 5.0: 20}),
            "delay_s": dice.pick({0.0: 60, 0.1: 20, 0.2: 20}),
        },
    }
    if dice.hits(0.3):
        radio |= {
            "jitter_s": dice.number(0.0, 0.3),
            "duplicate_fraction": dice.number(0.0, 0.2),
            "reorder_fraction": dice.number(0.0, 0.2),
        }
    if dice.hits(0.15):
        from_s = dice.number(5.0, 20.0, 1)
        apart = {"from_s": from_s, "until_s": round(from_s + dice.number(1.0, 15.0), 1)}
        radio["partitions"] = [{**apart, "groups": [[*range(1, mission["vehicles"], 2)] or [1]]}]
    if dice.hits(0.2):
        radio["ranging"] |= _hard_ranging(dice)
    if dice.hits(0.15):
        radio["path_loss"] = {
            "wall_db": dice.number(1.0, 7.0, 1),
            "shadowing_db": dice.pick({0.0: 50, 2.0: 30, 4.0: 20}),
        }
    if dice.hits(0.15):
        radio["channel"] = {"bit_rate_bit_s": dice.pick({57_600.0: 50, 250_000.0: 50})}
    return radio


def _hard_ranging(dice: Dice) -> Keys:
    """Draw errors that do not average out; blind is a vehicle behind, where its peers see it."""
    return {
        "range_bias_m": dice.pick({0.0: 40, 0.05: 40, 0.1: 20}),
        "bearing_bias_deg": dice.pick({0.0: 50, 2.0: 50}),
        "outlier_fraction": dice.pick({0.0: 50, 0.05: 30, 0.15: 20}),
        "blind": [{"from_deg": 150.0, "to_deg": 210.0}] if dice.hits(0.3) else [],
    }


# What goes wrong, and who interferes.

FAULTS: Mapping[str, tuple[float, Callable[[Dice], str]]] = {
    "controller": (8, lambda _: ""),
    "dead": (6, lambda _: ""),
    "motor": (4, lambda _: ""),
    "wind-gust": (4, lambda d: f"+{d.number(1, 4)},speed_m_s={d.number(2, 8)}"),
    "battery": (5, lambda d: f",fraction={d.number(0.0, 0.3)}"),
    "battery-drain": (3, lambda d: f",power_w={d.number(100, 2000)}"),
    "rangefinder": (4, lambda d: f"+{d.number(0.3, 20)}"),
    "rangefinder-stuck": (3, lambda d: f"+{d.number(0.3, 5)}"),
    "rangefinder-noise": (4, lambda d: f"+{d.number(1, 20)},noise_m={d.number(0.05, 0.3)}"),
    "gnss-loss": (4, lambda d: f"+{d.number(1, 20)}"),
    "gnss-glitch": (3, lambda d: f"+{d.number(1, 8)},offset_m={d.number(1, 10)}"),
    "drift": (4, lambda d: f"+{d.number(1, 20)},fraction={d.number(0.02, 0.2)}"),
    "freeze": (5, lambda d: f"+{d.number(0.5, 12)}"),
    "frozen-telemetry": (4, lambda d: f"+{d.number(0.5, 12)}"),
    "reboot": (3, lambda _: ""),
    "parameters-lost": (2, lambda _: ""),
    "nack": (5, lambda d: f"+{d.number(1, 20)}"),
    "ack-late": (4, lambda d: f"+{d.number(5, 30)},delay_s={d.number(0.1, 3)}"),
    "ack-lost": (5, lambda d: f"+{d.number(1, 20)}"),
    "silent-radio": (6, lambda d: f"+{d.number(0.5, 20)}"),
    "radio-loss": (6, lambda d: f"+{d.number(1, 20)},fraction={d.number(0.1, 1.0)}"),
    "link-loss": (6, lambda d: f"+{d.number(0.5, 15)},fraction={d.number(0.1, 1.0)}"),
    "link-delay": (6, lambda d: f"+{d.number(1, 15)},delay_s={d.number(0.05, 1)},jitter_s=0.1"),
    "link-burst": (4, lambda d: f"+{d.number(1, 15)},period_s={d.number(0.2, 2)}"),
    "link-duplicate": (4, lambda d: f"+{d.number(1, 30)}"),
    "link-reorder": (5, lambda d: f"+{d.number(1, 30)},fraction={d.number(0.1, 0.6)}"),
    "link-freeze": (5, lambda d: f"+{d.number(0.5, 12)}"),
}
"""Each kind's weight, and how long and how badly it strikes."""


def _fault(dice: Dice, vehicles: int, end_s: float) -> str:
    kind = dice.pick({kind: weight for kind, (weight, _) in FAULTS.items()})
    at = f"{kind}:{dice.whole(1, vehicles)}@{dice.number(0.0, end_s, 1)}"
    return at + FAULTS[kind][1](dice)


def _orders(dice: Dice, vehicles: int, end_s: float) -> list[Keys]:
    """Draw orders to one vehicle or all; who is paused is soon told to go on."""
    at_s = dice.number(0.0, end_s, 1)
    who = None if dice.hits(0.4) else dice.whole(1, vehicles)
    operator = dice.pick({"pause": 40, "return": 25, "land": 20, "abort": 15})
    orders = [{"time_s": at_s, "sysid": who, "operator": operator}]
    if operator == "pause":
        again_s = at_s + dice.number(0.2, 10.0, 1)
        orders.append({"time_s": round(again_s, 1), "sysid": who, "operator": "resume"})
    return orders


def _takeovers(dice: Dice, vehicles: int, end_s: float) -> list[Keys]:
    at_s, mode = dice.number(5.0, end_s, 1), dice.pick({"hold": 70, "land": 30})
    return [{"time_s": at_s, "sysid": dice.whole(1, vehicles), "mode": mode}]
