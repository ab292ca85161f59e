"""Tracks of peers against the truth, which only these tests know."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarm_ctl.agent.beacon import Beacon, mission_tag
from swarm_ctl.agent.params import RangingParams
from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.track import AGREEING, Track
from swarm_ctl.model import ZERO, Vec3

TAG = mission_tag("test")
RANGING = RangingParams()
FIX_S, BEACON_S = 0.1, 0.2
Floats = NDArray[np.float64]


def beacon(place: Vec3, velocity: Vec3) -> Beacon:
    return Beacon(TAG, Phase.EXPLORING, velocity, place, None, ())


@dataclass(frozen=True)
class Radio:
    """How badly peers are measured and heard."""

    range_m: float = 0.05
    bearing_rad: float = math.radians(3.0)
    bias_m: float = 0.0
    outliers: float = 0.0
    delay_s: float = 0.0
    loss: float = 0.0
    blind: Callable[[float], bool] = lambda _: False


def legs(rng: np.random.Generator, seconds: float) -> tuple[Floats, Floats]:
    """Draw places and velocities, 100 each second, of a peer that turns and brakes as ours do."""
    wanted, velocity, place = np.zeros(3), np.zeros(3), np.array([2.0, 0.5, 0.0])
    places, velocities = [], []
    for step in range(round(seconds * 100)):
        if step % 200 == 0:  # comes back whenever it is far
            way = rng.normal(size=3) * (1.0, 1.0, 0.3) - 0.7 * place * (abs(place) > 3.0)
            wanted = way / max(1.0, float(np.linalg.norm(way)))
        change = wanted - velocity
        velocity = velocity + change * min(1.0, 0.02 / max(1e-9, float(np.linalg.norm(change))))
        place = place + 0.01 * velocity
        places.append(place)
        velocities.append(velocity)
    return np.array(places), np.array(velocities)


def measured(place: Floats, radio: Radio, rng: np.random.Generator) -> Vec3:
    """Measure range and bearing of an offset."""
    range_m = float(np.linalg.norm(place))
    bearing = place / range_m + rng.normal(0.0, radio.bearing_rad, 3)
    if rng.random() < radio.outliers:
        bearing = rng.normal(size=3)
    bearing /= np.linalg.norm(bearing)
    return Vec3(*(bearing * (range_m + radio.bias_m + rng.normal(0.0, radio.range_m))))


@dataclass(frozen=True)
class Tracked:
    """What came of following a peer."""

    errors_m: Floats
    """(n, 3), once per tick."""
    sigmas_m: Floats
    raw_m: Floats
    """Errors of the latest fix, taken as it is."""
    track: Track

    @property
    def rms_m(self) -> float:
        """Root mean square of the distance to the truth."""
        return math.sqrt(float((self.errors_m**2).sum(axis=1).mean()))

    @property
    def raw_rms_m(self) -> float:
        return math.sqrt(float((self.raw_m**2).sum(axis=1).mean()))

    @property
    def nees(self) -> float:
        """Mean squared error in variances; 3 is what a filter that knows itself has."""
        return float(((self.errors_m**2).sum(axis=1) / self.sigmas_m**2).mean())


def follow(radio: Radio, seed: int = 1, seconds: float = 60.0) -> Tracked:
    """Let a peer fly for a minute, and a vehicle at rest follow it by radio."""
    rng = np.random.default_rng(seed)
    places, velocities = legs(rng, seconds)
    first = Vec3(*places[0])
    track = Track(first, RANGING.variance_m2(math.hypot(*first) ** 2), 0.0, 2.0)
    late, latest = round(100 * radio.delay_s), first
    errors, sigmas, raw = [], [], []
    for step in range(100, len(places), round(100 * FIX_S)):
        now, then = step / 100.0, step - late
        if rng.random() >= radio.loss and not radio.blind(now):
            latest = measured(places[then], radio, rng)
            track.fix(latest, RANGING.variance_m2(math.hypot(*latest) ** 2), then / 100.0, now)
        if step % round(100 * BEACON_S) == 0 and rng.random() >= radio.loss:
            track.hear(beacon(Vec3(*places[then]), Vec3(*velocities[then])), now)
        place, _, sigma_m = track.at(now)
        errors.append(np.array(place) - places[step])
        sigmas.append(sigma_m)
        raw.append(np.array(latest) - places[step])
    return Tracked(np.array(errors), np.array(sigmas), np.array(raw), track)


RADIOS = {
    "5 cm and 3°": Radio(),
    "5 cm and 3°, 0.2 s late, 30 % lost": Radio(delay_s=0.2, loss=0.3),
    "the same, 5 % of bearings anywhere": Radio(delay_s=0.2, loss=0.3, outliers=0.05),
    "the same, 70 % lost": Radio(delay_s=0.2, loss=0.7, outliers=0.05),
    "5 cm and 3°, 0.2 s late, 30 % lost, blind for 3 s of 6 s": Radio(
        delay_s=0.2, loss=0.3, blind=lambda now: now % 6.0 < 3.0
    ),
}


@pytest.mark.parametrize("radio", RADIOS.values(), ids=RADIOS.keys())
def test_a_track_is_nearer_to_the_truth_than_the_fixes_it_is_made_of(radio: Radio) -> None:
    tracked = [follow(radio, seed) for seed in range(3)]
    assert all(flown.rms_m < 0.6 * flown.raw_rms_m for flown in tracked)


@pytest.mark.parametrize("radio", RADIOS.values(), ids=RADIOS.keys())
def test_a_track_knows_how_far_it_may_be_off(radio: Radio) -> None:
    nees = np.mean([follow(radio, seed).nees for seed in range(5)])
    assert 1.0 < nees < 4.5


def test_a_perfect_radio_is_followed_to_centimetres() -> None:
    tracked = follow(Radio(range_m=0.0, bearing_rad=0.0))
    assert np.linalg.norm(tracked.errors_m, axis=1).max() < 0.05


def test_the_figures_of_the_documentation_are_those_of_these_radios() -> None:
    page = (Path(__file__).parents[2] / "docs" / "localisation.md").read_text(encoding="utf-8")
    for name, radio in RADIOS.items():
        told = next(line for line in page.splitlines() if line.startswith(f"| {name} |"))
        tracked = [follow(radio, seed) for seed in range(5)]
        found = [np.mean([flown.raw_rms_m for flown in tracked])]
        found += [np.mean([flown.rms_m for flown in tracked])]
        assert [float(cell) for cell in told.split("|")[2:4]] == pytest.approx(found, abs=0.02)


def test_a_bias_of_the_range_stays_in_the_track_and_grows_no_more() -> None:
    assert follow(Radio(bias_m=0.2)).rms_m == pytest.approx(0.2, abs=0.05)


# -- outliers ------------------------------------------------------------------------------------

NEAR, ELSEWHERE = Vec3(3.0, 0.0, 0.0), Vec3(0.5, 1.0, 0.0)


def settled() -> Track:
    """Give the track of a peer that stays where it is."""
    track = Track(NEAR, 0.01, 0.0, 2.0)
    for tick in range(1, 20):
        track.fix(NEAR, 0.01, tick * 0.1, tick * 0.1)
    return track


def test_a_single_outlier_is_refused_and_counted() -> None:
    track = settled()
    track.fix(ELSEWHERE, 0.01, 2.0, 2.0)
    assert track.refused == 1
    assert track.at(2.0)[0] == pytest.approx(NEAR)
    assert track.rival_at(2.0) is None


def test_outliers_that_disagree_with_each_other_are_refused_however_many() -> None:
    track = settled()
    for tick in range(20, 26):
        track.fix(Vec3(3.0, 4.0 * (-1.0) ** tick, 0.0), 0.01, tick * 0.1, tick * 0.1)
        assert track.rival_at(tick * 0.1) is None
    assert track.at(2.6)[0] == pytest.approx(NEAR)


def test_two_refused_fixes_that_agree_are_a_doubt_and_three_are_right() -> None:
    track = settled()
    for tick in range(20, 20 + AGREEING - 1):
        track.fix(ELSEWHERE, 0.01, tick * 0.1, tick * 0.1)
    assert track.rival_at(2.1) == pytest.approx(ELSEWHERE)
    assert track.at(2.1)[0] == pytest.approx(NEAR)
    track.fix(ELSEWHERE, 0.01, 2.2, 2.2)
    assert track.at(2.2)[0] == pytest.approx(ELSEWHERE)
    assert track.rival_at(2.2) is None


def test_a_fix_that_fits_ends_the_doubt() -> None:
    track = settled()
    for place in (ELSEWHERE, ELSEWHERE, NEAR):
        track.fix(place, 0.01, 2.0, 2.0)
    assert track.rival_at(2.0) is None


# -- odometry ------------------------------------------------------------------------------------


def test_a_peers_frame_that_jumps_moves_it_nowhere() -> None:
    track = settled()
    track.hear(beacon(ZERO, ZERO), 2.0)
    track.hear(beacon(Vec3(50.0, 0.0, 0.0), ZERO), 2.2)
    assert track.at(2.2)[0] == pytest.approx(NEAR, abs=0.01)


def test_what_a_peer_flew_while_nothing_was_heard_counts() -> None:
    track = settled()
    track.hear(beacon(ZERO, ZERO), 2.0)
    track.hear(beacon(Vec3(0.5, 0.0, 0.0), Vec3(1.0, 0.0, 0.0)), 3.0)
    assert track.at(3.0)[0].x == pytest.approx(3.5, abs=0.01)


# -- nonsense ------------------------------------------------------------------------------------

far = st.floats(-700.0, 700.0)
vectors = st.builds(Vec3, far, far, far)
times = st.floats(-5.0, 20.0)
fixes = st.tuples(vectors, st.floats(1e-4, 1e4), st.floats(0.0, 1.0), times)
heard = st.tuples(vectors, vectors, times)


@settings(max_examples=200, deadline=None)
@given(vectors, st.lists(fixes | heard, max_size=60))
def test_no_story_makes_a_variance_negative_or_a_place_no_number(
    first: Vec3, story: list[tuple[Vec3, float, float, float] | tuple[Vec3, Vec3, float]]
) -> None:
    track, now = Track(first, 0.01, 0.0, 2.0), 0.0
    for told in story:
        now += told[-1]  # time that runs backwards, too
        if len(told) == 4:
            track.fix(told[0], told[1], now - told[2], now)
        else:
            track.hear(beacon(told[0], told[1]), now)
        place, velocity, sigma_m = track.at(now)
        assert all(map(math.isfinite, (*place, *velocity, sigma_m)))
        assert 0.0 < sigma_m <= 20.0
        assert min(track.pp, track.vv) > 0.0
        assert track.pv * track.pv <= track.pp * track.vv * 1.001
