"""Who decides where robots go: planners without memory as rows, explorers one by one."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.experiment.case import Case
from swarm_ctl.experiment.odometry import Odometry
from swarm_ctl.explore import rows
from swarm_ctl.explore.chance import Bools, Floats
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.planner import RANGE_ORDER, plan_with

MOST_PAYLOADS = 12
"""TUNNEL payloads that a robot sends per second."""
TALK_S = 1.0
"""Time between two beacons of a robot."""
_RADIO = 1_000_002
"""In the place of a robot's index: the generator of what a trial's radio loses."""
_LEVEL = tuple(RANGE_ORDER.index(name) for name in ("front", "right", "left"))
_VERTICAL = tuple(RANGE_ORDER.index(name) for name in ("up", "down"))


class Minds(Protocol):
    """What decides for all robots of all trials: robot i of trial t is row t * robots + i."""

    is_chained: bool
    """Whether it hears who is in range of a peer, and so on, like one who is in its own."""

    def decide(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats,
        alive: Bools,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Give velocities (n, d) and headings (n,) from what `Planner.step` takes."""

    def notice(self, last_m: Floats, position_m: Floats, peers_m: Floats, alive: Bools) -> None:
        """Take from where to where all have moved (n, d), and whom they hear now."""


def make_minds(case: Case, seed: int, trials: range, kernels: rows.Kernels) -> Minds:
    """Build what drives the robots of some trials, a generator from (seed, trial, robot) each."""
    if case.planner.kind == "explore":
        return Explorers(case, seed, trials)
    return Rows(case, seed, trials, kernels)


class Rows:
    """Planners without a memory, all in one."""

    is_chained = True

    def __init__(self, case: Case, seed: int, trials: range, kernels: rows.Kernels) -> None:
        self._planner = plan_with(
            case.planner,
            speed_m_s=case.speed_m_s,
            climb_m_s=case.climb_m_s or case.speed_m_s,
            seeds=[(seed, trial, robot) for trial in trials for robot in range(case.robots)],
            kernels=kernels,
        )

    def decide(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats,
        alive: Bools,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Plan for all, alive or not."""
        del alive
        plan = self._planner.step(position_m, heading_rad, ranges_m, peers_m)
        return plan.velocity_m_s, plan.heading_rad

    def notice(self, last_m: Floats, position_m: Floats, peers_m: Floats, alive: Bools) -> None:
        """Remember nothing."""


class Explorers:
    """An explorer per robot, with an odometry and a radio of its own."""

    is_chained = False

    def __init__(self, case: Case, seed: int, trials: range) -> None:
        self._case = case
        self._explorers = [
            Explorer(
                case.planner,
                speed_m_s=case.speed_m_s,
                climb_m_s=case.climb_m_s or case.speed_m_s,
                seed=(seed, trial, robot),
                sysid=robot + 1,
            )
            for trial in trials
            for robot in range(case.robots)
        ]
        self._odometry = Odometry(
            case.odometry_drift,
            case.dimensions,
            [(seed, trial, robot, 1) for trial in trials for robot in range(case.robots)],
        )
        self._chances = [np.random.default_rng([seed, trial, _RADIO]) for trial in trials]
        self._nobody_m: Floats = np.empty((1, 0, case.dimensions))
        self._talk_steps = max(1, round(TALK_S / case.planner.period_s))
        self._steps = 0

    def decide(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats,
        alive: Bools,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Let each plan in its own frame; then it sees the walls that its beams have hit."""
        own_m = self._odometry.position_m
        velocity_m_s, heading = np.zeros_like(position_m), heading_rad.copy()
        hits_m, hit = _hits(own_m, heading_rad, ranges_m)
        near: Bools = np.isfinite(peers_m[:, :, 0])
        has_hit: Bools = np.asarray(hit.any(axis=1))
        has_peers: Bools = np.asarray(near.any(axis=1))
        for row in alive.nonzero()[0].tolist():
            explorer, at = self._explorers[row], slice(row, row + 1)
            heard_m = peers_m[row, near[row]][None] if has_peers[row] else self._nobody_m
            plan = explorer.step(own_m[at], heading_rad[at], ranges_m[at], heard_m)
            if has_hit[row]:
                explorer.observe_hits(hits_m[row, hit[row]])
            velocity_m_s[row], heading[row] = plan.velocity_m_s[0], plan.heading_rad[0]
        return velocity_m_s, heading

    def notice(self, last_m: Floats, position_m: Floats, peers_m: Floats, alive: Bools) -> None:
        """Count the way, and talk once a second."""
        self._odometry.move(position_m - last_m)
        if self._steps % self._talk_steps == 0:
            robots = self._case.robots
            for trial in range(len(self._chances)):
                these = slice(trial * robots, (trial + 1) * robots)
                self._talk(trial, these, peers_m[these], alive[these])
        self._steps += 1

    def _talk(self, trial: int, these: slice, offset_m: Floats, alive: Bools) -> None:
        """Send beacons to all in range, then payloads; the radio loses some for each receiver."""
        explorers, own_m = self._explorers[these], self._odometry.position_m[these].tolist()
        near: Bools = np.isfinite(offset_m[:, :, 0])
        if near.any():
            now = (self._steps + 1) * self._case.planner.period_s
            heard = near & self._arrives(trial, near.shape)
            if self._case.position_noise_m:
                noise = self._chances[trial].normal(size=offset_m.shape)
                offset_m = offset_m + self._case.position_noise_m * noise
            told = {j: explorers[j].summary() for j in np.flatnonzero(heard.any(axis=0)).tolist()}
            for i, j in np.argwhere(heard).tolist():
                explorers[i].hear_peer(
                    j + 1, now, offset_m[i, j].tolist(), own_m[j], explorers[j].target_m,
                    own_position_m=own_m[i],
                )  # fmt: skip
                explorers[i].hear_summary(j + 1, told[j])
        for i in alive.nonzero()[0].tolist():
            for payload in explorers[i].outbox(MOST_PAYLOADS):
                heard = near[:, i] & self._arrives(trial, (len(near),))
                for j in heard.nonzero()[0].tolist():
                    explorers[j].hear_chunk(i + 1, payload)

    def _arrives(self, trial: int, shape: tuple[int, ...]) -> Bools:
        """Draw whom of `shape` receivers a message reaches."""
        if not self._case.message_loss:
            return np.ones(shape, dtype=np.bool_)
        arrives: Bools = self._chances[trial].random(shape) >= self._case.message_loss
        return arrives


def _hits(own_m: Floats, heading_rad: Floats, ranges_m: Floats) -> tuple[Floats, Bools]:
    """Find the points (n, beams, d) where beams end in the own frames, and which hit anything."""
    beams = [*_LEVEL, *_VERTICAL][: 3 if own_m.shape[1] == 2 else 5]
    cos, sin, none = np.cos(heading_rad), np.sin(heading_rad), np.zeros_like(heading_rad)
    north = np.stack([cos, -sin, sin, none, none], axis=1)
    east = np.stack([sin, cos, -cos, none, none], axis=1)
    down = np.tile([0.0, 0.0, 0.0, -1.0, 1.0], (len(own_m), 1))
    ways = np.stack([north, east, down], axis=2)[:, : len(beams), : own_m.shape[1]]
    far_m = ranges_m[:, beams]
    hit: NDArray[np.bool_] = np.isfinite(far_m)
    return own_m[:, None, :] + np.where(hit, far_m, 0.0)[:, :, None] * ways, hit
