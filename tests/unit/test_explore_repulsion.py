import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore.repulsion import Repulsion, repulsion

NAN = float("nan")
coordinate = st.floats(-10.0, 10.0)


@pytest.mark.parametrize(
    ("peer", "pushes"),
    [
        ([2.0, 0.0], [-0.5, 0.0]),  # a peer 2 m north: south, 1/2
        ([0.0, -4.0], [0.0, 0.25]),  # a peer 4 m west: east, 1/4
        ([0.0, 0.05], [0.0, -10.0]),  # closer than 0.1 m counts as 0.1 m
    ],
)
def test_one_peer_pushes_straight_away(peer: list[float], pushes: list[float]) -> None:
    vector_m, heard = repulsion(np.array([[peer]]))
    assert vector_m[0] == pytest.approx(pushes)
    assert heard[0]


def test_a_cluster_pushes_away_from_its_centroid_with_the_sum_of_inverses() -> None:
    peers_m = np.array([[[1.0, 1.0], [1.0, -1.0], [0.5, 0.0], [NAN, NAN]]])
    vector_m, _ = repulsion(peers_m)
    assert vector_m[0] == pytest.approx([-(2.0 / np.sqrt(2.0) + 2.0), 0.0])  # Eq. 3


def test_in_3d_the_nearer_peer_decides_the_direction() -> None:
    peers_m = np.array([[[0.5, 0.0, 0.0], [-2.0, 0.0, 0.0]]])
    vector_m, _ = repulsion(peers_m)
    assert vector_m[0] == pytest.approx([-2.5, 0.0, 0.0])


def test_the_vertical_weight_parts_vehicles_in_height() -> None:
    below = np.array([[[1.0, 0.0, 1.0]]])  # a peer north and below
    even, _ = repulsion(below)
    strong, _ = repulsion(below, 2.0)
    assert even[0, 0] == pytest.approx(even[0, 2])
    assert strong[0, 2] == pytest.approx(2.0 * strong[0, 0])
    assert strong[0, 2] < 0.0  # up
    assert np.linalg.norm(strong) == pytest.approx(np.linalg.norm(even))


def test_the_length_is_capped() -> None:
    vector_m, _ = repulsion(np.array([[[0.2, 0.0, 0.0]]]), 1.0, 2.0)
    assert vector_m[0] == pytest.approx([-2.0, 0.0, 0.0])


def test_peers_all_around_and_peers_on_the_spot_push_nowhere() -> None:
    for peers_m in ([[1.0, 0.0], [-1.0, 0.0]], [[0.0, 0.0], [NAN, NAN]]):
        vector_m, heard = repulsion(np.array([peers_m]))
        assert vector_m[0] == pytest.approx([0.0, 0.0])
        assert heard[0]


@settings(derandomize=True)
@given(
    st.sampled_from([2, 3]).flatmap(
        lambda d: st.lists(st.lists(coordinate, min_size=d, max_size=d), min_size=1, max_size=6)
    )
)
def test_the_push_is_never_towards_the_centroid_in_2d_and_never_too_long(
    peers: list[list[float]],
) -> None:
    peers_m = np.array([peers])
    vector_m, _ = repulsion(peers_m)
    longest_m = (1.0 / np.maximum(np.linalg.norm(peers_m[0], axis=1), 0.1)).sum()
    assert np.linalg.norm(vector_m[0]) <= longest_m * (1.0 + 1e-9)
    if peers_m.shape[2] == 2:
        assert vector_m[0] @ peers_m[0].mean(axis=0) <= 1e-9


def force(*, kept: bool) -> Repulsion:
    return Repulsion(2, 2, kept=kept, vertical=1.0, longest_m=None)


@pytest.mark.parametrize("nobody", [np.empty((2, 0, 2)), np.full((2, 3, 2), NAN)])
def test_the_last_repulsion_is_kept_or_null_when_nobody_is_heard(
    nobody: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> None:
    one_hears = np.array([[[2.0, 0.0]], [[NAN, NAN]]])
    kept, null = force(kept=True), force(kept=False)
    for each in (kept, null):
        each.update(nobody)
        assert (each.vector_m == 0.0).all()  # before the first contact
        each.update(one_hears)
        assert each.vector_m.tolist() == [[-0.5, 0.0], [0.0, 0.0]]
        each.update(nobody)
    assert kept.vector_m.tolist() == [[-0.5, 0.0], [0.0, 0.0]]
    assert (null.vector_m == 0.0).all()


def test_a_kept_repulsion_into_an_obstacle_is_dropped() -> None:
    kept = force(kept=True)
    kept.update(np.array([[[2.0, 0.0]], [[2.0, 0.0]]]))
    kept.release(np.array([0, 1]), np.array([[-1.0, 0.5], [1.0, 0.0]]))
    assert kept.vector_m.tolist() == [[0.0, 0.0], [-0.5, 0.0]]
