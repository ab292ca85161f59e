"""The peers of one explorer: where each was last, where it was heading, and what that asks for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.frontier import Others
from swarm_ctl.explore.memory import three
from swarm_ctl.explore.planner import PlannerParams

CLAIM_S = 60.0
"""The strip that a peer in contact is going to fly counts as seen for so long."""
FRESH_S = 20.0
"""A peer is taken to be where it was last seen for so long, when frontiers are shared out."""


class Company:
    """Who was heard of and when; all places are metres in the vehicle's own frame, `now` in s."""

    def __init__(self, params: PlannerParams) -> None:
        self._params = params
        self._d = params.dimensions
        self._peers: dict[int, list[float]] = {}
        """When it was heard, its place, its target, and 1 if it has one: 8 numbers each."""

    def __len__(self) -> int:
        """Give how many peers were ever heard."""
        return len(self._peers)

    def meet(
        self, sysid: int, now: float, place_m: Sequence[float], target_m: Sequence[float] | None
    ) -> None:
        """Note where a peer is, and where it is heading to."""
        target = [0.0, 0.0, 0.0, 0.0] if target_m is None else [*three(target_m), 1.0]
        self._peers[sysid] = [now, *three(place_m), *target]

    def claims(self, now: float) -> list[tuple[list[float], list[float]]]:
        """Give the strips that peers were going to fly when last heard: from where to where."""
        d, heard = self._d, self._heard(now, CLAIM_S)
        return [(seen[1 : 1 + d], seen[4 : 4 + d]) for seen in heard if seen[7]]

    def others(self, now: float) -> Others:
        """Give the peers among whom frontiers are shared out."""
        d, params = self._d, self._params
        return Others(
            [seen[1 : 1 + d] for seen in self._heard(now, FRESH_S)],
            [seen[4 : 4 + d] for seen in self._heard(now, 3.0 * params.memory_s) if seen[7]],
            params.target_exclusion_m,
        )

    def _heard(self, now: float, within_s: float) -> list[list[float]]:
        return [seen for seen in self._peers.values() if now - seen[0] < within_s]

    def is_ahead(self, now: float, place_m: Sequence[float], unit: Sequence[float]) -> bool:
        """Tell whether a peer was within 2 m and 60 degrees of a direction in the last second."""
        here = three(place_m)
        for seen in self._peers.values():
            away = [there - own for there, own in zip(seen[1:4], here, strict=True)]
            far = math.hypot(*away)
            along = sum(part * u for part, u in zip(away, unit, strict=True))
            if now - seen[0] < 1.0 and far < 2.0 and along > 0.5 * far:
                return True
        return False

    def crowding(
        self, now: float, place_m: Sequence[float], ends_m: Floats, width_m: float
    ) -> Floats:
        """Rate ends of steps, (k, 3), by how near they come to peers and their targets: (k,)."""
        here, memory_s = np.array(three(place_m)), self._params.memory_s
        seen = np.array(list(self._peers.values()))
        ages = now - seen[:, 0]
        weights = np.where(ages < 3.0 * memory_s, np.exp(-ages / memory_s), 0.0)
        far = np.sqrt(((ends_m[:, None, :] - seen[None, :, 1:4]) ** 2).sum(axis=2))
        from_here = np.sqrt(((here - seen[:, 1:4]) ** 2).sum(axis=1))
        to_target = np.sqrt(((ends_m[:, None, :] - seen[None, :, 4:7]) ** 2).sum(axis=2))
        scale = width_m / 0.6
        near = np.where(far < from_here[None, :], np.exp(-far / (3.0 * scale)), 0.0)
        near += np.exp(-to_target / (1.5 * scale)) * seen[:, 7]
        crowded: Floats = near @ weights
        return crowded
