"""Files of live results: JSON lines, CSV, GeoJSON and GeoPackage."""

import csv
import io
import json
import os
import sqlite3
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from basetree.errors import InputError
from calib import RigidTransform
from edgetree.measure import Failure, PointEstimate
from edgetree.results import LIVE_SCHEMA
from edgetree.sinks import (
    CsvTracksSink,
    GeoJsonSink,
    GeoPackageSink,
    JsonLinesSink,
    MapOrigin,
    Sink,
)

FILE_SINKS = {
    "live.jsonl": JsonLinesSink,
    "tracks.csv": CsvTracksSink,
    "map.geojson": GeoJsonSink,
    "map.gpkg": GeoPackageSink,
}


def written(path: Path, sink: Sink, *results) -> Path:
    for result in results:
        sink.write(result)
    sink.close()
    return path


@pytest.mark.parametrize("name", ["live.jsonl", "tracks.csv"])
def test_lines_are_in_the_file_at_once(tmp_path, live_result, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    sink = FILE_SINKS[name](path)
    sizes = []
    for number in range(3):
        sink.write(live_result(number))
        sizes.append(path.stat().st_size)
        assert path.read_bytes().endswith(b"\n")
    assert 0 < sizes[0] < sizes[1] < sizes[2]
    sink.close()
    assert path.stat().st_size == sizes[2]
    sink.close()


@pytest.mark.skipif(os.name != "posix", reason="open files cannot be emptied")
def test_a_table_that_a_log_rotation_emptied_has_its_column_names(tmp_path, live_result) -> None:
    path = tmp_path / "tracks.csv"
    sink = CsvTracksSink(path)
    sink.write(live_result(0))
    before = path.read_text().splitlines()
    os.truncate(path, 0)  # as `copytruncate` of logrotate does
    sink.write(live_result(1))
    sink.write(live_result(2))
    sink.close()
    after = path.read_text().splitlines()
    assert after.count(before[0]) == 1
    assert (after[0], len(after)) == (before[0], 2 * len(before) - 1)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("name", ["live.jsonl", "tracks.csv"])
def test_a_full_disk_is_named(live_result, name: str) -> None:
    sink = FILE_SINKS[name](Path("/dev/full"))
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        sink.write(live_result())
    with suppress(OSError):
        sink.close()


@pytest.mark.parametrize("name", ["map.geojson", "map.gpkg"])
def test_a_file_appears_whole_when_its_sink_is_closed(tmp_path, live_result, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    sink = FILE_SINKS[name](path)
    sink.write(live_result())
    assert path.read_bytes() == b"old"
    sink.close()
    content = path.read_bytes()
    assert len(content) > 500
    sink.close()
    assert path.read_bytes() == content
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", FILE_SINKS)
def test_a_file_that_cannot_be_written_is_named_at_once(tmp_path, name: str) -> None:
    with pytest.raises(InputError, match=name):
        FILE_SINKS[name](tmp_path / "no folder" / name)


@pytest.mark.parametrize("name", FILE_SINKS)
def test_a_run_without_stems_gives_a_readable_file(tmp_path, live_result, name: str) -> None:
    sink = FILE_SINKS[name](tmp_path / name)
    assert written(tmp_path / name, sink, live_result(stems=0)).stat().st_size > 0


def test_json_lines_hold_trees_with_numbers_and_tracks_with_intervals(
    tmp_path, live_result
) -> None:
    path = tmp_path / "live.jsonl"
    written(path, JsonLinesSink(path), live_result(3, stems=3), live_result(4, measured=False))
    first, second = (json.loads(line) for line in path.read_text("utf-8").splitlines())
    assert (first["schema"], first["frame"], first["time_s"]) == (LIVE_SCHEMA, 3, 0.3)
    assert [(tree["tree"], tree["track"]) for tree in first["trees"]] == [(1, 1), (2, 2)]
    assert len(first["trees"][0]["box_px"]) == 4
    assert first["trees"][1]["metres"]["diameter_m"] == pytest.approx(0.222)
    assert [track["tree"] for track in first["tracks"]] == [1, 2, None]
    track = first["tracks"][0]
    assert track["diameter_low95_m"] == pytest.approx(track["diameter_m"] - 1.96 * 0.006)
    assert first["stages_ms"] == {"detect": 31.0, "measure": 6.5}
    assert second["trees"][0]["metres"] is None
    assert second["metres_need"] == "no depth"


def test_json_lines_to_a_stream_come_at_once_and_leave_it_open(live_result) -> None:
    stream = io.StringIO()
    sink = JsonLinesSink(stream)
    sink.write(live_result(5))
    assert json.loads(stream.getvalue())["frame"] == 5
    sink.close()
    assert not stream.closed


def test_the_table_has_a_row_for_each_frame_and_stem(tmp_path, live_result) -> None:
    path = tmp_path / "tracks.csv"
    failed = live_result(1, stems=1, dbh_m=Failure("=too high"), warnings=("a", "b"))
    written(path, CsvTracksSink(path), live_result(0, stems=3), failed)
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["frame"], row["track"], row["tree"]) for row in rows] == [
        ("0", "1", "1"),
        ("0", "2", "2"),
        ("0", "3", ""),
        ("1", "1", ""),
    ]
    assert float(rows[0]["diameter_m"]) == pytest.approx(0.211)
    assert float(rows[0]["position_camera_z_m"]) == pytest.approx(3.0)
    assert (rows[3]["dbh_m"], rows[3]["dbh_failure"]) == ("", "'=too high")
    assert rows[3]["warnings"] == "a; b"


def test_the_map_keeps_the_last_state_of_confirmed_stems(tmp_path, live_result) -> None:
    path = tmp_path / "map.geojson"
    results = (live_result(0, stems=3), live_result(9, stems=1), live_result(10, 5, state="new"))
    collection = json.loads(written(path, GeoJsonSink(path), *results).read_text("utf-8"))
    features = collection["features"]
    assert (collection["type"], collection["coordinates"]) == ("FeatureCollection", "local metres")
    assert [feature["id"] for feature in features] == [1, 2, 3]
    assert [one["properties"]["last_seen_s"] for one in features] == [0.9, 0.0, 0.0]
    assert features[0]["geometry"] == {"type": "Point", "coordinates": [-0.5, 3.0, 0.1]}
    assert features[0]["properties"]["y_std_m"] == 0.05


def test_a_stem_that_another_one_absorbed_is_not_in_the_map(tmp_path, live_result) -> None:
    path = tmp_path / "map.geojson"
    results = (live_result(0, stems=3), live_result(1, stems=1, absorbed=(3,)))
    collection = json.loads(written(path, GeoJsonSink(path), *results).read_text("utf-8"))
    assert [feature["id"] for feature in collection["features"]] == [1, 2]


@pytest.mark.parametrize(("has_poses", "expected"), [(False, [2, 3]), (True, [1])])
def test_stems_of_other_maps_are_not_placed_on_the_earth(
    tmp_path, live_result, caplog, has_poses, expected
) -> None:
    """The origin is that of the poses, or without any of the first map."""
    path = tmp_path / "map.geojson"
    pose = RigidTransform.identity() if has_poses else None
    results = (live_result(0, stems=3), live_result(1, stems=1, map_part=2, pose=pose))
    features = json.loads(
        written(path, GeoJsonSink(path, MapOrigin(64.0, 20.0)), *results).read_text("utf-8")
    )["features"]
    assert [feature["id"] for feature in features] == expected
    assert f"{3 - len(expected)} stem" in caplog.text

    local = json.loads(written(path, GeoJsonSink(path), *results).read_text("utf-8"))["features"]
    assert [one["properties"]["map_part"] for one in local] == [2, 1, 1]


def test_a_map_with_an_origin_is_in_degrees(tmp_path, live_result) -> None:
    path = tmp_path / "map.geojson"
    place = PointEstimate(np.array([0.0, 100.0, 2.0]), np.full(3, 0.1))
    sink = GeoJsonSink(path, MapOrigin(64.0, 20.0, height_m=250.0, heading_deg=90.0))
    written(path, sink, live_result(stems=1, position_m=place))
    longitude, latitude, height = json.loads(path.read_text("utf-8"))["features"][0]["geometry"][
        "coordinates"
    ]
    # 100 m east: one degree of longitude at 64 degrees of latitude is 48.93 km.
    assert (longitude - 20.0) * 48_933 == pytest.approx(100.0, abs=0.05)
    assert latitude == pytest.approx(64.0, abs=2e-8 + 100**2 / 6.38e6 / 111e3)
    assert height == pytest.approx(252.0, abs=0.002)


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 45.0, 64.0, 88.0])
def test_north_of_the_map_is_north_on_the_earth(latitude_deg: float) -> None:
    origin = MapOrigin(latitude_deg, -120.0)
    longitude, latitude, height = origin.geodetic(np.array([0.0, 1000.0, 0.0]))
    # Length of a degree of latitude, from the meridian's radius of curvature.
    radius_m = 6_335_439.327 / (1 - 6.69437999e-3 * np.sin(np.radians(latitude_deg)) ** 2) ** 1.5
    assert np.radians(latitude - latitude_deg) * radius_m == pytest.approx(1000.0, abs=0.1)
    assert longitude == pytest.approx(-120.0, abs=1e-9)
    assert height == pytest.approx(1000.0**2 / 2 / radius_m, rel=0.01)
    assert origin.geodetic(np.zeros(3)) == pytest.approx((-120.0, latitude_deg, 0.0), abs=1e-8)


@pytest.mark.parametrize(
    ("values", "told"),
    [((91.0, 0.0), "latitude_deg is 91"), ((0.0, float("nan")), "longitude_deg is nan")],
)
def test_an_impossible_origin_is_refused(values: tuple[float, float], told: str) -> None:
    with pytest.raises(InputError, match=told):
        MapOrigin(*values)


@pytest.mark.parametrize("origin", [None, MapOrigin(64.0, 20.0)])
def test_a_geopackage_has_the_tables_of_the_standard(tmp_path, live_result, origin) -> None:
    path = written(tmp_path / "m.gpkg", GeoPackageSink(tmp_path / "m.gpkg", origin), live_result())
    srs_id = -1 if origin is None else 4326
    content = path.read_bytes()
    assert content.startswith(b"SQLite format 3\0")
    assert content[68:72] == b"GPKG"
    with sqlite3.connect(path) as database:
        (version,) = database.execute("PRAGMA user_version").fetchone()
        systems = {row[0] for row in database.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")}
        contents = database.execute(
            "SELECT table_name, data_type, srs_id, min_x, max_y FROM gpkg_contents"
        ).fetchall()
        geometry = database.execute("SELECT * FROM gpkg_geometry_columns").fetchall()
        rows = database.execute("SELECT geom, track, diameter_m FROM stems").fetchall()
        assert database.execute("PRAGMA foreign_key_check").fetchall() == []
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert version == 10300
    assert systems == {-1, 0, 4326}
    assert geometry == [("stems", "geom", "POINT", srs_id, 1, 0)]
    header, point = rows[0][0][:8], struct.unpack("<BI3d", rows[0][0][8:])
    assert struct.unpack("<2sBBi", header) == (b"GP", 0, 1, srs_id)
    assert point[:2] == (1, 1001)
    expected = (-0.5, 3.0, 0.1) if origin is None else origin.geodetic(np.array([-0.5, 3.0, 0.1]))
    assert point[2:] == pytest.approx(expected)
    assert contents[0][:3] == ("stems", "features", srs_id)
    assert contents[0][3] == pytest.approx(expected[0])
    assert [row[1] for row in rows] == [1, 2, 3]
    assert rows[1][2] == pytest.approx(0.222)


@pytest.mark.parametrize("name", list(FILE_SINKS))
def test_paths_may_be_texts(tmp_path, live_result, name: str) -> None:
    path = tmp_path / name
    sink = FILE_SINKS[name](str(path))
    sink.write(live_result(0))
    sink.close()
    assert path.stat().st_size
