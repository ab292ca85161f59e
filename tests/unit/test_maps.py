"""Maps of map_server: reading them, and rays against a walker over their pixels."""

from __future__ import annotations

import itertools
import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from PIL import Image

from mock_vehicle.errors import WorldError
from mock_vehicle.maps import OccupancyMap, chessboard_distance, load_map
from mock_vehicle.world import load_world

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
REAL_MAPS = ROOT.parent / "shared/data/maps"
HEADER: dict[str, Any] = {
    "image": "map.pgm",
    "resolution": 0.5,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
# a room of 6 x 4 free cells with one pillar, as an image: the top row is the highest y
PICTURE = np.array(
    [
        [0, 0, 0, 0, 0, 0, 0, 0],
        [0, 254, 254, 254, 254, 254, 254, 0],
        [0, 254, 254, 254, 254, 0, 254, 0],
        [0, 254, 254, 254, 254, 254, 254, 0],
        [0, 254, 254, 254, 254, 254, 205, 0],
        [0, 0, 0, 0, 0, 0, 0, 0],
    ],
    dtype=np.uint8,
)


def save(folder: Path, picture: NDArray[np.uint8] = PICTURE, **keys: Any) -> Path:
    header = {**HEADER, **keys}
    Image.fromarray(picture).save(folder / header["image"])
    (folder / "map.yaml").write_text(yaml.safe_dump(header), encoding="utf-8")
    return folder / "map.yaml"


def seen(chart: OccupancyMap, x: float, y: float, z: float, toward: tuple[float, ...]) -> float:
    east, north, up = np.array(toward) / np.linalg.norm(toward)
    way = np.array([[north, east, -up]])
    return float(chart.cast(np.array([[y, x, -z]]), way, 40.0)[0])


def test_rows_run_from_north_to_south_and_grey_is_solid(tmp_path: Path) -> None:
    chart = load_map(save(tmp_path), 2.5)
    assert seen(chart, 0.75, 0.75, 1, (1, 0, 0)) == pytest.approx(2.25, abs=1e-5), "grey"
    assert seen(chart, 0.75, 1.25, 1, (1, 0, 0)) == pytest.approx(2.75, abs=1e-5)
    assert seen(chart, 0.75, 1.75, 1, (1, 0, 0)) == pytest.approx(1.75, abs=1e-5), "pillar"
    assert seen(chart, 0.75, 0.75, 1, (0, 1, 0)) == pytest.approx(1.75, abs=1e-5)
    assert seen(chart, 0.75, 0.75, 1, (-1, 0, 0)) == pytest.approx(0.25, abs=1e-5)
    assert seen(chart, 0.75, 0.75, 1, (1, 1, 0)) == pytest.approx(1.75 * math.sqrt(2), abs=1e-5)


def test_sloping_rays_mind_the_height_of_the_map(tmp_path: Path) -> None:
    chart = load_map(save(tmp_path), 2.0)
    assert seen(chart, 0.75, 1.75, 1, (1.75, 0, 0.9)) == pytest.approx(
        math.hypot(1.75, 0.9), abs=1e-4
    )
    assert seen(chart, 0.75, 1.75, 1, (1.75, 0, 1.1)) == math.inf, "over the pillar and away"
    down = seen(chart, 2.75, 1.75, 3, (0, 0, -1))
    assert down == pytest.approx(1.0, abs=1e-4), "on top of the pillar"
    assert seen(chart, 2.25, 1.75, 3, (0, 0, -1)) == math.inf, "no floor of its own"
    over = seen(chart, 0.75, 1.75, 3, (1, 0, -0.5))
    assert over == pytest.approx(math.hypot(2.0, 1.0), abs=1e-4)
    assert seen(chart, 0.75, 1.75, 3, (1, 0, 0)) == math.inf
    assert seen(chart, 0.75, 1.75, 3, (0, 0, 1)) == math.inf


def test_rays_from_solid_cells_or_beyond_the_map_read_zero(tmp_path: Path) -> None:
    chart = load_map(save(tmp_path), 2.0)
    assert seen(chart, 2.75, 1.75, 1, (1, 0, 0)) == 0.0
    assert seen(chart, -30.0, 1.75, 1, (1, 0, 0)) == 0.0


def test_range_ends_the_march(tmp_path: Path) -> None:
    chart = load_map(save(tmp_path), 2.0)
    ray = np.array([[1.25, 0.75, -1.0]]), np.array([[0.0, 1.0, 0.0]])
    assert chart.cast(*ray, 2.74)[0] == math.inf
    assert chart.cast(*ray, 2.76)[0] == pytest.approx(2.75, abs=1e-5)


def walker_says(path: Path, points: Floats) -> NDArray[Any]:
    """An independent witness: whether x, y fall on a pixel that is not free."""
    header = yaml.safe_load(path.read_text(encoding="utf-8"))
    picture = np.asarray(Image.open(path.parent / header["image"]).convert("L"))
    x0, y0, yaw = header["origin"]
    local = (points[:, 0] - x0 + 1j * (points[:, 1] - y0)) * np.exp(-1j * yaw)
    column = np.floor(local.real / header["resolution"]).astype(int)
    row = picture.shape[0] - 1 - np.floor(local.imag / header["resolution"]).astype(int)
    rows, columns = picture.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    grey = picture[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)].astype(float)
    taken = grey / 255 if header["negate"] else 1 - grey / 255
    solid: NDArray[Any] = ~inside | (taken >= header["free_thresh"])
    return solid


@pytest.mark.parametrize("yaw", [0.0, 0.5, -2.2])
def test_rays_end_where_a_walker_meets_a_solid_pixel(tmp_path: Path, yaw: float) -> None:
    rng = np.random.default_rng(8)
    picture = np.where(rng.random((60, 80)) < 0.04, 0, 254).astype(np.uint8)
    path = save(tmp_path, picture, resolution=0.1, origin=[-3.0, 2.0, yaw])
    chart = load_map(path, 3.0)
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    origins = rng.uniform([0, 0], [8, 6], (300, 2)) @ turn + [-3.0, 2.0]
    angle = rng.uniform(0, 2 * math.pi, 300)
    angle[:40] = np.arange(40) * math.pi / 2 + yaw
    ways = np.column_stack([np.cos(angle), np.sin(angle)])
    level = np.full((300, 1), -1.0)
    measured = chart.cast(
        np.hstack([origins[:, ::-1], level]), np.hstack([ways[:, ::-1], 0 * level]), 20.0
    )
    np.testing.assert_array_equal(
        chart.occupied(np.hstack([origins[:, ::-1], level])), walker_says(path, origins)
    )
    nudges = np.array(list(itertools.product([-1e-4, 1e-4], repeat=2)))
    for origin, way, distance in zip(origins, ways, measured, strict=True):
        before = np.arange(0.0, distance - 1e-4, 0.01)
        hits = walker_says(path, origin + before[:, None] * way)
        assert not hits.any()
        assert walker_says(path, origin + distance * way + nudges).any()


def test_clearance_agrees_with_the_nearest_pixel(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    picture = np.where(rng.random((40, 50)) < 0.01, 0, 254).astype(np.uint8)
    chart = load_map(save(tmp_path, picture, resolution=0.1), 3.0)
    solid = np.argwhere(np.pad(picture[::-1].T == 0, 30, constant_values=True)) - 30
    cells = rng.integers(0, [50, 40], (200, 2))
    gap = np.abs(cells[:, None] - solid) - 0.5
    truth = 0.1 * np.sqrt((np.maximum(gap, 0.0) ** 2).sum(axis=2)).min(axis=1)
    points = np.column_stack([(cells + 0.5)[:, ::-1] * 0.1, np.full(200, -1.0)])
    measured = chart.clearance(points)
    free = ~chart.occupied(points)
    np.testing.assert_allclose(measured[free], np.minimum(truth[free], 2.0), atol=1e-6)
    assert (measured[~free] < 0.0).all()
    assert chart.clearance(points - np.array([0.0, 0.0, 2.5]))[~free] == pytest.approx(0.5), "above"


def test_steps_are_kings_moves_to_the_nearest_solid_cell() -> None:
    blocked = np.random.default_rng(2).random((23, 31)) < 0.02
    cells = np.indices(blocked.shape).reshape(2, -1).T
    solid = np.argwhere(blocked)
    truth = np.abs(cells[:, None] - solid).max(axis=2).min(axis=1).reshape(blocked.shape)
    np.testing.assert_array_equal(chessboard_distance(blocked), truth)


def ascii_pgm(picture: NDArray[np.uint8]) -> bytes:
    rows = "\n".join(" ".join(map(str, row)) for row in picture.tolist())
    return f"P2\n# by hand\n{picture.shape[1]} {picture.shape[0]}\n255\n{rows}\n".encode()


def test_every_kind_of_image_reads_alike(tmp_path: Path) -> None:
    plain = load_map(save(tmp_path), 2.0).blocked
    negated = load_map(save(tmp_path, 255 - PICTURE, negate=1), 2.0).blocked
    png = load_map(save(tmp_path, image="map.png"), 2.0).blocked
    colour = load_map(
        save(tmp_path, np.repeat(PICTURE[..., None], 3, axis=2), image="rgb.png"), 2.0
    )
    deep = Image.fromarray(PICTURE.astype(np.uint16) * 257)
    path = save(tmp_path, image="deep.png")
    deep.save(tmp_path / "deep.png")
    sixteen = load_map(path, 2.0).blocked
    path = save(tmp_path)
    (tmp_path / "map.pgm").write_bytes(ascii_pgm(PICTURE))
    ascii_ = load_map(path, 2.0).blocked
    assert plain.sum() == plain.size - 22
    for other in (negated, png, colour.blocked, sixteen, ascii_):
        np.testing.assert_array_equal(other, plain)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"resolution": 0}, "resolution: should be greater than 0 m, not 0.0"),
        ({"resolution": "fine"}, "resolution: should be a number, not 'fine'"),
        ({"resolution": None}, "resolution: is required"),
        ({"occupied_thresh": 1.5}, "occupied_thresh: should be within 0..1, not 1.5"),
        ({"free_thresh": 0.7}, "free_thresh: should be within 0..occupied_thresh (0.65), not 0.7"),
        ({"mode": "scale"}, "mode: scale is not supported, only trinary is"),
        ({"negate": 2}, "negate: should be 0 or 1, not 2"),
        ({"origin": [0, 0]}, "origin: should be [x, y, yaw], not [0, 0]"),
        ({"origin": [0, "a", 0]}, "origin[1]: should be a number, not 'a'"),
    ],
)
def test_a_wrong_header_is_refused_in_one_sentence(
    tmp_path: Path, keys: dict[str, Any], sentence: str
) -> None:
    path = save(tmp_path, **keys)
    with pytest.raises(WorldError) as caught:
        load_map(path, 2.0)
    assert str(caught.value) == f"{path}: {sentence}"


def test_a_missing_or_unreadable_image_is_refused(tmp_path: Path) -> None:
    path = save(tmp_path)
    for content, reason in ((b"no image at all", "cannot be read"), (b"P5\n8 6\n255\n", "cannot")):
        (tmp_path / "map.pgm").write_bytes(content)
        with pytest.raises(WorldError, match=rf"map\.yaml: image: map\.pgm {reason}"):
            load_map(path, 2.0)
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(WorldError, match=r"map\.yaml: image: map\.pgm does not exist"):
        load_map(path, 2.0)
    with pytest.raises(WorldError, match=r"map\.yaml: image: map\.pgm has no free cell"):
        load_map(save(tmp_path, PICTURE * 0), 2.0)


def test_a_header_that_is_no_header_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    for text, reason in (("[1", "is not YAML"), ("3", "should hold keys"), ("a: 1", "image: ")):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(WorldError, match=rf"map\.yaml: {reason}"):
            load_map(path, 2.0)


def test_a_world_takes_its_bounds_and_its_sight_from_its_map(tmp_path: Path) -> None:
    save(tmp_path, origin=[10.0, 20.0, math.pi / 2])
    path = tmp_path / "world.yaml"
    path.write_text(
        "name: m\nmap: {file: map.yaml, height_m: 2.0}\nceiling_m: 2.0\n"
        "starts: [{position_m: [8.75, 21.25]}]\n",
        encoding="utf-8",
    )
    world = load_world(path)
    np.testing.assert_allclose(world.low_ned_m, [20.5, 7.5, -2.0])
    np.testing.assert_allclose(world.high_ned_m, [23.5, 9.5, 0.0])
    a = np.array([[20.75, 8.25, -1.0], [20.75, 8.75, -1.0]])
    b = a + np.array([2.5, 0.0, 0.0])
    assert world.line_of_sight(a, b).tolist() == [False, True]
    assert (~world.occupancy(0.5, 1.0).blocked).sum() == 22
    drawn = world.outline()["map"]
    solid = np.repeat(np.arange(len(drawn["blocked_rle"])) % 2, drawn["blocked_rle"])
    assert solid.reshape(drawn["shape"]).sum() == 48 - 22
    path.write_text(path.read_text().replace("8.75, 21.25", "8.25, 22.75"), encoding="utf-8")
    with pytest.raises(WorldError, match=r"starts\[0\]\.position_m: \(8\.25, 22\.75\) is inside"):
        load_world(path)


def test_the_script_draws_the_maps_that_are_here(tmp_path: Path) -> None:
    folder = ROOT / "missions/worlds"
    runpy.run_path(str(folder / "make_maps.py"))["write"](tmp_path)
    drawn = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert drawn == {path.name: path.read_bytes() for path in (folder / "maps").iterdir()}


@pytest.mark.skipif(not REAL_MAPS.is_dir(), reason="the real building maps are not at hand")
@pytest.mark.parametrize("name", ["gdc_3", "gdc_3ne", "willow_full_0.05"])
def test_real_buildings_load_and_rays_end_at_their_walls(tmp_path: Path, name: str) -> None:
    source = REAL_MAPS / f"{name}.yaml"
    path = tmp_path / "world.yaml"
    path.write_text(f"name: real\nmap: {{file: {source}}}\nceiling_m: 2.8\n", encoding="utf-8")
    world = load_world(path)
    places, _ = world.starts(30, seed=2)
    assert world.free_cells(0.25, 1.5, places).sum() * 0.25**2 > 200.0
    angles = np.random.default_rng(1).uniform(0, 2 * math.pi, 30)
    ways = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(30)])
    measured = world.cast(places - [0, 0, 1.5], ways, 100.0)
    assert np.isfinite(measured).all()
    nudges = np.array(list(itertools.product([-1e-3, 1e-3], repeat=2)))
    for place, way, distance in zip(places[:, 1::-1], ways[:, 1::-1], measured, strict=True):
        before = np.arange(0.0, distance - 1e-3, 0.01)
        assert not walker_says(source, place + before[:, None] * way).any()
        assert walker_says(source, place + distance * way + nudges).any()
