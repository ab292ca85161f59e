"""Where bodies fit, what they can get to, and where they start."""

from typing import Any

import numpy as np
import pytest

from swarm_ctl.experiment.batch import Case, Field
from swarm_ctl.experiment.room import Room
from swarm_ctl.explore.planner import PlannerParams

# North is the first axis: a wall across a field of 10 m x 4 m, from side to side but for a gap.
LEFT, RIGHT = (2.0, 1.0), (2.0, 8.0)


def walled(gap_m: float) -> Field:
    return Field(
        (0.0, 0.0),
        (4.0, 10.0),
        boxes_m=((0.0, 3.9, 1.0, 4.1), (1.0 + gap_m, 3.9, 4.0, 4.1)),
    )


def room(field: Field, **changes: Any) -> Room:
    params = {"dimensions": changes.pop("dimensions", 2)}
    settings = {"robots": 20, "steps": 1, "sample_steps": 1} | changes
    return Room(Case(field, PlannerParams.model_validate(params), **settings))


@pytest.mark.parametrize(
    ("gap_m", "start", "metres2"),
    [
        (1.0, LEFT, 40.0 - 3.0 * 0.2),  # all but the wall
        (0.6, LEFT, 40.0 - 3.4 * 0.2),  # as wide as the body: it slides through
        (0.5, LEFT, 15.6),  # too narrow: this side of the wall
        (0.5, RIGHT, 23.6),
        (0.5, None, 23.6),  # anywhere: the larger room; the other one is a closed pocket
    ],
)
def test_what_counts_can_be_reached_from_the_start(
    gap_m: float, start: tuple[float, float] | None, metres2: float
) -> None:
    cells = room(walled(gap_m), start_m=start).coverable((40, 100))
    assert np.count_nonzero(cells) * 0.01 == pytest.approx(metres2, abs=0.15)


def test_the_larger_room_counts_on_whichever_side_it_is() -> None:
    for low, high, metres2 in ((3.9, 4.1, 23.6), (5.9, 6.1, 23.6)):
        cells = room(Field((0.0, 0.0), (4.0, 10.0), ((0.0, low, 4.0, high),))).coverable((40, 100))
        assert np.count_nonzero(cells) * 0.01 == pytest.approx(metres2)


def test_nobody_starts_in_a_closed_pocket() -> None:
    places = np.concatenate([room(walled(0.5)).starts(1, trial)[0] for trial in range(20)])
    assert len(places) == 400
    assert places[:, 1].min() > 4.4 - 1e-9
    assert places[:, 1].max() > 9.0


def test_an_open_field_is_reached_to_its_corners() -> None:
    assert room(Field((0.0, 0.0), (4.0, 10.0))).coverable((40, 100)).all()


def test_a_niche_that_no_body_enters_does_not_count() -> None:
    niche = Field((0.0, 0.0), (4.0, 4.0), boxes_m=((0.0, 1.0, 3.0, 1.2), (0.0, 1.6, 3.0, 1.8)))
    cells = room(niche).coverable((40, 40))
    assert not cells[:30, 12:16].any()
    assert cells[:, :10].all()
    assert cells[30:].all()


def test_a_shelf_in_a_hall_is_flown_over_and_under() -> None:
    """A shelf from wall to wall, 1.8 to 2.0 m above the floor: it divides, unless one gets by."""
    shelf = (0.0, 0.0, -2.0, 4.0, 4.0, -1.8)
    low, high, size = (0.0, 0.0, -4.0), (4.0, 4.0, 0.0), (16, 16, 16)
    params: dict[str, Any] = {"dimensions": 3, "footprint_m": 0.5, "start_m": (2.0, 2.0)}
    divided = Field(low, high, boxes_m=(shelf,), cell_m=0.25)
    under = room(divided, start_height_m=1.0, **params).coverable(size)
    assert under[:, :, 9:].all()  # the part below the shelf
    assert not under[:, :, :7].any()
    passable = Field(low, high, boxes_m=((*shelf[:3], 4.0, 3.0, -1.8),), cell_m=0.25)
    assert room(passable, start_height_m=1.0, **params).coverable(size)[:, :, :8].all()


def test_a_row_starts_at_one_height_and_in_order() -> None:
    hall = Field((0.0, 0.0, -6.0), (20.0, 20.0, 0.0))
    given = {"dimensions": 3, "robots": 5, "start_m": (1.2, 10.0), "jitter_m": 0.0}
    places, _ = room(hall, start_spacing_m=1.5, start_height_m=1.0, **given).starts(1, 0)
    assert places.tolist() == [[1.2, east, -1.0] for east in (7.0, 8.5, 10.0, 11.5, 13.0)]
    anywhere, _ = room(hall, **given).starts(1, 0)
    assert len(set(anywhere[:, 2].tolist())) == 5
    assert anywhere[:, 2].min() >= -5.7
    assert anywhere[:, 2].max() <= -0.3


@pytest.mark.parametrize(
    ("field", "changes", "misfit"),
    [
        (walled(1.0), {}, ""),
        (walled(1.0), {"start_m": LEFT}, ""),
        (walled(1.0), {"start_m": (2.5, 4.0)}, "start_m"),  # in the wall
        (walled(1.0), {"start_m": (1.5, 4.0)}, ""),  # in the doorway
        (walled(1.0), {"start_m": (2.5, 3.58)}, "start_m"),  # nearer than the jitter
        (walled(1.0), {"start_m": LEFT, "start_spacing_m": 1.0}, "start_m"),  # too long a row
        (walled(1.0), {"body_m": 4.1}, "world"),
        (Field((0.0, 0.0), (2.0, 2.0), boxes_m=((0.5, 0.5, 1.5, 1.5),)), {"body_m": 1.0}, "world"),
    ],
)
def test_what_leaves_no_room_is_named(field: Field, changes: dict[str, Any], misfit: str) -> None:
    assert room(field, **changes).misfit == misfit
