"""Runs in the words of others: each format read back by somebody else's reader."""

from __future__ import annotations

import base64
import csv
import json
import math
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import geojson
import numpy as np
import pytest
import shapely
from flown import fly
from mcap.reader import make_reader
from shapely.geometry import shape

from swarm_ctl.errors import SwarmError
from swarm_ctl.export import WRITERS, export_run
from swarm_ctl.export.areas import outline, searched_ground
from swarm_ctl.export.plan import simplified
from swarm_ctl.frames import Geodetic, geodetic_to_ned
from swarm_ctl.record.reader import Run

PLACE = {"latitude_deg": 60.0, "longitude_deg": 24.0, "amsl_m": 10.0}
ORIGIN = Geodetic(60.0, 24.0, 10.0)
WORLD: dict[str, Any] = {"gnss": PLACE, "radio": {"radius_m": 30.0}}


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of three vehicles' run that found a victim, at 60° north."""
    folder = tmp_path_factory.mktemp("export")
    return fly(folder, vehicles=3, duration_s=40.0, world=WORLD)


@pytest.fixture
def run(flown: Path, tmp_path: Path) -> Path:
    """Give a copy of it to spoil."""
    return shutil.copytree(flown, tmp_path / "copy")


def as_real(run: Path, **frame: Any) -> None:
    """Take away what only a referee knows, as if real vehicles had flown."""
    shutil.rmtree(run / "truth")
    started = json.loads((run / "mission.json").read_text())
    started["mission"]["frame"] |= frame
    (run / "mission.json").write_text(json.dumps({**started, "mode": "fly"}))


def features(file: Path) -> dict[str, list[dict[str, Any]]]:
    kinds: dict[str, list[dict[str, Any]]] = {}
    for feature in json.loads(file.read_text())["features"]:
        kinds.setdefault(feature["properties"]["kind"], []).append(feature)
    return kinds


# -- every format ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_is_written_beside_the_record_and_the_same_each_time(
    run: Path, kind: str
) -> None:
    out = export_run(run, kind)
    assert out.parent == run
    files = sorted(out.iterdir()) if out.is_dir() else [out]
    first = [file.read_bytes() for file in files]
    assert all(first)
    export_run(run, kind)
    assert [file.read_bytes() for file in files] == first


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"kind": "pdf"}, "--format pdf: expected one of mcap, geojson, plan, kml, csv"),
        ({"kind": "kml", "sysid": 2}, "--vehicle: only a plan is of one vehicle, not kml"),
        ({"kind": "plan", "sysid": 9}, "--vehicle 9: did not fly"),
        ({"kind": "kml", "origin": "north"}, "--origin north: expected LATITUDE,LONGITUDE"),
        ({"kind": "kml", "origin": "91,0"}, "--origin 91,0: expected"),
        ({"kind": "kml", "origin": "nan,0"}, "--origin nan,0: expected"),
        ({"kind": "kml", "out": Path("/nowhere/at/all.kml")}, "cannot be written: No such file"),
        ({"kind": "csv", "out": Path("/proc/nothing")}, "cannot be"),
    ],
)
def test_what_cannot_be_is_one_sentence(run: Path, options: Any, sentence: str) -> None:
    with pytest.raises(SwarmError) as refused:
        export_run(run, **options)
    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("kind", ["geojson", "kml", "plan"])
def test_a_run_that_is_nowhere_on_the_globe_says_so_and_takes_a_place(run: Path, kind: str) -> None:
    as_real(run, shared="surveyed", starts_m={"1": [0, 0, 0], "2": [2, 0, 0], "3": [4, 0, 0]})
    with pytest.raises(SwarmError, match="give the place of its origin with --origin"):
        export_run(run, kind)
    assert export_run(run, kind, origin="60,24").stat().st_size > 1000


def test_vehicles_that_share_no_frame_are_on_no_map(run: Path) -> None:
    as_real(run)
    with pytest.raises(SwarmError, match="declare a shared frame"):
        export_run(run, "geojson", origin="60,24")
    assert export_run(run, "mcap").stat().st_size > 1000, "each from its own start"
    assert export_run(run, "csv").is_dir()


def test_a_run_that_was_killed_at_once_has_no_map_but_what_there_is(run: Path) -> None:
    for entry in run.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
        elif entry.name != "mission.json":
            entry.unlink()
    for kind in ("geojson", "kml", "plan"):
        with pytest.raises(SwarmError, match="nothing has a place on a map"):
            export_run(run, kind, origin="60,24")
    assert export_run(run, "mcap").stat().st_size > 0
    assert not any(export_run(run, "csv").iterdir())


# -- MCAP ------------------------------------------------------------------------------------------


def test_an_mcap_file_read_back_has_all_channels_and_counts(flown: Path, tmp_path: Path) -> None:
    out = export_run(flown, "mcap", tmp_path / "run.mcap")
    run, found = Run.read(flown), 1
    seconds = len(run.truth.arrays["coverage_time_s"])
    with out.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {c.id: c.topic for c in summary.channels.values()}
        counts = {
            topics[number]: count
            for number, count in summary.statistics.channel_message_counts.items()
        }
        names = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        attached = {one.name for one in reader.iter_attachments()}
    vehicles = range(1, 4)
    assert counts == {
        "/vehicles": 1,
        "/paths": 1,
        "/map": 1,
        "/tf": len(run.truth.arrays["track_time_s"]),
        "/coverage": math.ceil(float(run.truth.arrays["coverage_time_s"][-1]) / 5.0) + 1,
        "/victims": found,
        "/links": seconds,
        "/log": len(run.entries),
        "/swarm": seconds,
        **{f"/vehicle_{n}/fix": pytest.approx(seconds, abs=2) for n in vehicles},
        **{f"/vehicle_{n}/battery": len(run.battery(n).time_s) for n in vehicles},
    }
    assert names["/tf"] == "foxglove.FrameTransforms"
    assert names["/coverage"] == "foxglove.Grid"
    assert names["/log"] == "foxglove.Log"
    assert names["/vehicle_2/fix"] == "foxglove.LocationFix"
    assert {names[topic] for topic in ("/vehicles", "/paths", "/victims", "/links")} == {
        "foxglove.SceneUpdate"
    }
    assert attached == {"mission.json", "summary.json"}


def test_every_message_of_an_mcap_file_fits_its_schema(flown: Path, tmp_path: Path) -> None:
    out = export_run(flown, "mcap", tmp_path / "run.mcap")
    with out.open("rb") as file:
        last_ns = 0
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            fits(json.loads(message.data), json.loads(schema.data), channel.topic)
            assert message.log_time >= last_ns, "in the order of time"
            last_ns = message.log_time


def fits(value: Any, schema: dict[str, Any], where: str) -> None:
    """Hold a value to the part of JSON Schema that the schemas use; nothing unknown is in it."""
    match schema["type"]:
        case "object":
            assert value.keys() <= schema["properties"].keys(), where
            for key, inner in value.items():
                fits(inner, schema["properties"][key], f"{where}.{key}")
        case "array":
            assert schema.get("minItems", 0) <= len(value), where
            for inner in value:
                fits(inner, schema["items"], where)
        case "integer":
            assert isinstance(value, int), where
            assert schema.get("minimum", value) <= value <= schema.get("maximum", value), where
        case "number":
            assert isinstance(value, int | float), where
        case "string":
            assert isinstance(value, str), where
            if schema.get("contentEncoding") == "base64":
                base64.b64decode(value, validate=True)
        case "boolean":
            assert isinstance(value, bool), where


def test_the_last_grid_shows_what_was_searched(flown: Path, tmp_path: Path) -> None:
    out = export_run(flown, "mcap", tmp_path / "run.mcap")
    with out.open("rb") as file:
        grids = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages("/coverage")]
    cells = np.frombuffer(base64.b64decode(grids[-1]["data"]), np.uint8).reshape(-1, 4)
    share = np.count_nonzero(cells[:, 2] == 200) / np.count_nonzero(cells[:, 3])
    final = json.loads((flown / "summary.json").read_text())["coverage_final_fraction"]
    assert share == pytest.approx(final, abs=0.01)
    rows = len(cells) // grids[-1]["column_count"]
    assert grids[-1]["row_stride"] * rows == cells.size


def test_frames_are_east_north_up_and_head_where_the_vehicle_flies(
    flown: Path, tmp_path: Path
) -> None:
    out = export_run(flown, "mcap", tmp_path / "run.mcap")
    run = Run.read(flown)
    (track,) = (one for one in run.tracks if one.sysid == 2)
    with out.open("rb") as file:
        moves = [
            transform
            for _, _, message in make_reader(file).iter_messages("/tf")
            for transform in json.loads(message.data)["transforms"]
            if transform["child_frame_id"] == "vehicle_2"
        ]
    at = len(moves) // 2
    north, east, down = track.ned_m[at]
    where = moves[at]["translation"]
    assert (where["x"], where["y"], where["z"]) == pytest.approx((east, north, -down), abs=1e-3)
    fast = next(
        row for row in range(at, len(moves) - 1) if math.dist(*track.ned_m[row : row + 2]) > 0.2
    )
    turn = 2.0 * math.atan2(moves[fast]["rotation"]["z"], moves[fast]["rotation"]["w"])
    ahead = track.ned_m[fast + 1] - track.ned_m[fast]
    assert math.cos(turn - math.atan2(ahead[0], ahead[1])) == pytest.approx(1.0, abs=1e-3)


def test_without_its_extra_mcap_says_what_to_install(run: Path, tmp_path: Path) -> None:
    script = (
        "import sys; sys.modules['mcap.writer'] = None; from pathlib import Path\n"
        "from swarm_ctl.export import export_run\n"
        f"try: export_run(Path({str(run)!r}), 'mcap', Path({str(tmp_path)!r}) / 'x.mcap')\n"
        "except Exception as error: print(error)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert said.stdout == "MCAP needs the extra: pip install 'swarm-ctl[export]'\n"


# -- GeoJSON ---------------------------------------------------------------------------------------


def test_geojson_is_valid_by_other_peoples_readers(flown: Path, tmp_path: Path) -> None:
    out = export_run(flown, "geojson", tmp_path / "run.geojson")
    read = geojson.loads(out.read_text())
    assert read.is_valid, read.errors()
    kinds = Counter(feature["properties"]["kind"] for feature in read["features"])
    assert kinds["victim"] == kinds["victim_area"] == kinds["searched"] == 1
    assert kinds["path"] == 3
    for feature in read["features"]:
        drawn = shape(feature["geometry"])
        assert drawn.is_valid, shapely.is_valid_reason(drawn)
        west, south, east, north = drawn.bounds
        assert 23.99 < west <= east < 24.01
        assert 59.99 < south <= north < 60.01


def test_rings_run_as_the_standard_asks(flown: Path, tmp_path: Path) -> None:
    kinds = features(export_run(flown, "geojson", tmp_path / "run.geojson"))
    polygons = [shape(kinds["victim_area"][0]["geometry"])]
    polygons += shape(kinds["searched"][0]["geometry"]).geoms
    for polygon in polygons:
        assert polygon.exterior.is_ccw
        assert not any(hole.is_ccw for hole in polygon.interiors)


def test_rescuers_are_led_to_where_the_victim_lies(flown: Path, tmp_path: Path) -> None:
    (victim,) = features(export_run(flown, "geojson", tmp_path / "run.geojson"))["victim"]
    longitude, latitude, altitude = victim["geometry"]["coordinates"]
    at = geodetic_to_ned(Geodetic(latitude, longitude, altitude), ORIGIN)
    assert at == pytest.approx((4.0, 4.0, -0.3), abs=0.05)
    told = victim["properties"]
    assert told["name"] == "v1"
    assert told["found_utc"].startswith("2024-01-01T00:00:"), "virtual time begins there"
    assert told["found_by"] in {1, 2, 3}


def test_the_searched_area_is_that_of_the_summary(flown: Path, tmp_path: Path) -> None:
    kinds = features(export_run(flown, "geojson", tmp_path / "run.geojson"))
    searched, missed = (
        kinds[kind][0]["properties"]["area_m2"] for kind in ("searched", "not_searched")
    )
    final = json.loads((flown / "summary.json").read_text())["coverage_final_fraction"]
    assert searched / (searched + missed) == pytest.approx(final, abs=0.01)
    degrees2 = shape(kinds["searched"][0]["geometry"]).area
    metre_deg = 1.0 / 111_320.0
    assert degrees2 / metre_deg**2 * math.cos(math.radians(60.0)) == pytest.approx(
        searched, rel=0.01
    )


def test_real_vehicles_have_searched_what_lies_around_their_paths(run: Path) -> None:
    as_real(run, shared="surveyed", starts_m={"1": [6, 6, 0], "2": [8, 6, 0], "3": [10, 6, 0]})
    ground = searched_ground(Run.read(run))
    assert ground is not None
    assert "as if there were no walls" in ground.source
    length_m = json.loads((run / "summary.json").read_text())["path_length_m"]
    assert 5.0 < ground.area_m2(ground.searched) < 2.0 * length_m + 30.0
    kinds = features(export_run(run, "geojson", origin="60,24,10"))
    assert "not_searched" not in kinds, "nobody knows"


def test_satellites_have_told_in_the_beacons_where_the_starts_are(tmp_path: Path) -> None:
    run = fly(tmp_path, vehicles=2, duration_s=8.0, world={"gnss": PLACE}, frame={"shared": "gnss"})
    starts = Run.read(run).starts_ned_m
    as_real(run)
    told = Run.read(run)
    assert told.origin is not None
    at = geodetic_to_ned(told.origin, ORIGIN)
    assert at == pytest.approx(starts[1], abs=0.1)
    apart = np.subtract(starts[2], starts[1])
    assert told.starts_ned_m[2] == pytest.approx(apart, abs=0.1)


@pytest.mark.parametrize("seed", range(20))
def test_any_area_is_outlined_cell_by_cell(seed: int) -> None:
    chance = np.random.default_rng(seed)
    cells = chance.random(chance.integers(1, 30, 2)) < chance.random()
    drawn = shapely.MultiPolygon(
        [
            shapely.Polygon(
                *[[(c, r) for r, c in ring] for ring in polygon[:1]],
                [[(c, r) for r, c in hole] for hole in polygon[1:]],
            )
            for polygon in outline(cells)
        ]
    )
    assert drawn.is_valid
    assert drawn.area == cells.sum()
    rows, columns = np.indices(cells.shape)
    assert (shapely.contains_xy(drawn, columns + 0.5, rows + 0.5) == cells).all()


# -- plan ------------------------------------------------------------------------------------------


def test_a_plan_visits_every_victim_and_comes_home(flown: Path, tmp_path: Path) -> None:
    plan = json.loads(export_run(flown, "plan", tmp_path / "run.plan").read_text())
    assert (plan["fileType"], plan["version"], plan["groundStation"]) == (
        "Plan",
        1,
        "QGroundControl",
    )
    mission = plan["mission"]
    assert [item["command"] for item in mission["items"]] == [22, 16, 20]
    assert [item["doJumpId"] for item in mission["items"]] == [1, 2, 3]
    hold_s, _, _, yaw, latitude, longitude, height_m = mission["items"][1]["params"]
    at = geodetic_to_ned(Geodetic(latitude, longitude, 10.0), ORIGIN)
    assert at[:2] == pytest.approx((4.0, 4.0), abs=0.05)
    assert (hold_s, yaw, height_m) == (5.0, None, 1.5)
    assert mission["firmwareType"] == 12
    assert {"geoFence", "rallyPoints"} <= plan.keys()


def test_a_plan_of_one_vehicle_is_its_path(flown: Path, tmp_path: Path) -> None:
    out = export_run(flown, "plan", tmp_path / "run.plan", sysid=2)
    items = json.loads(out.read_text())["mission"]["items"][1:-1]
    (track,) = (one for one in Run.read(flown).tracks if one.sysid == 2)
    assert 5 < len(items) < len(track.time_s)
    ways = [
        geodetic_to_ned(Geodetic(item["params"][4], item["params"][5], 10.0), ORIGIN)[:2]
        for item in items
    ]
    off_m = shapely.LineString(ways).hausdorff_distance(shapely.LineString(track.ned_m[:, :2]))
    assert off_m < 0.35


def test_a_run_without_victims_has_no_plan_to_them(run: Path) -> None:
    (run / "events.jsonl").write_text("")
    with pytest.raises(SwarmError, match="no victim was found; --vehicle N"):
        export_run(run, "plan")


def test_a_straight_path_has_two_ends_and_a_corner_stays() -> None:
    path = np.array([[0, 0, 0], [1, 0.1, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0]], dtype=float)
    assert simplified(path, 0.3).tolist() == [[0, 0, 0], [2, 0, 0], [2, 2, 0]]


# -- KML, tables -----------------------------------------------------------------------------------


def test_kml_has_a_time_for_every_place(flown: Path, tmp_path: Path) -> None:
    root = ET.parse(export_run(flown, "kml", tmp_path / "run.kml")).getroot()  # noqa: S314 - ours
    kml, gx = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"
    tracks = list(root.iter(f"{gx}Track"))
    assert len(tracks) == 3
    run = Run.read(flown)
    for drawn, track in zip(tracks, run.tracks, strict=True):
        when = [element.text or "" for element in drawn.iter(f"{kml}when")]
        places = [element.text or "" for element in drawn.iter(f"{gx}coord")]
        assert len(when) == len(places) == len(track.time_s)
        assert when == sorted(when)
        longitude, latitude, _ = map(float, places[0].split())
        at = geodetic_to_ned(Geodetic(latitude, longitude, 10.0), ORIGIN)
        assert at[:2] == pytest.approx(track.ned_m[0][:2], abs=0.05)
    names = [element.text for element in root.iter(f"{kml}name")]
    assert "v1" in names
    assert any(name and name.startswith("searched: ") for name in names)


def test_tables_are_tidy(flown: Path, tmp_path: Path) -> None:
    out = export_run(flown, "csv", tmp_path / "tables")
    rows = {}
    for file in out.iterdir():
        with file.open(newline="") as opened:
            rows[file.stem] = list(csv.DictReader(opened))
    assert rows.keys() == {
        "vehicles", "paths", "victims", "reports", "events", "coverage", "contacts", "battery",
    }  # fmt: skip
    run = Run.read(flown)
    assert len(rows["paths"]) == sum(len(track.time_s) for track in run.tracks)
    assert len(rows["events"]) == len(run.entries)
    (victim,) = rows["victims"]
    assert float(victim["north_m"]) == pytest.approx(4.0, abs=0.05)
    assert float(victim["latitude_deg"]) == pytest.approx(60.0, abs=0.001)
    assert {row["sysid"] for row in rows["battery"]} == {"1", "2", "3"}
    assert all(int(row["sysid"]) < int(row["peer"]) for row in rows["contacts"])


# -- telemetry logs --------------------------------------------------------------------------------


def test_mavlogdump_reads_the_telemetry_logs(flown: Path) -> None:
    dump = Path(sys.executable).with_name("mavlogdump.py")
    log = flown / "tlogs" / "vehicle-002.tlog"
    said = subprocess.run(
        [sys.executable, dump, "--format", "json", "--types", "LOCAL_POSITION_NED,HEARTBEAT", log],
        capture_output=True,
        text=True,
        check=True,
    )
    messages = [json.loads(line) for line in said.stdout.splitlines()]
    kinds = Counter(message["meta"]["type"] for message in messages)
    until_s = messages[-1]["meta"]["timestamp"] - 1_704_067_200.0
    assert kinds["LOCAL_POSITION_NED"] == pytest.approx(10.0 * until_s, rel=0.05)
    lowest_m = min(m["data"]["z"] for m in messages if m["meta"]["type"] == "LOCAL_POSITION_NED")
    assert lowest_m == pytest.approx(-1.5, abs=0.5)
