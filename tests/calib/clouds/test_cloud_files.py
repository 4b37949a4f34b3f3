"""Point clouds as other programs write them are read, and broken ones are refused in one line."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cloud_files import (
    PLY_TEXT,
    POINTS,
    kitti,
    las,
    npy,
    npz,
    pcd_binary,
    pcd_compressed,
    pcd_text,
    ply_binary,
)

from basetree.errors import InputError
from basetree.files import current_limits, set_limits
from calib.clouds import read_cloud
from calib.clouds.lzf import decompress

FILES = {
    "text.ply": PLY_TEXT,
    "little.ply": ply_binary("<"),
    "big.ply": ply_binary(">"),
    "binary.pcd": pcd_binary(),
    "compressed.pcd": pcd_compressed(),
    "scan.bin": kitti(),
    "scan.pcd.bin": kitti(5),
    "columns.npz": npz(),
    "points.npz": npz(("points",)),
    "points.npy": npy(),
}


@pytest.mark.parametrize("name", FILES)
def test_files_of_other_programs_are_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    np.testing.assert_array_equal(read_cloud(tmp_path / name).points_m, POINTS)


def test_a_beam_without_return_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "text.pcd").write_bytes(pcd_text())
    np.testing.assert_array_equal(read_cloud(tmp_path / "text.pcd").points_m, POINTS[:2])


def test_las_is_read_with_scale_and_offset(tmp_path: Path) -> None:
    pytest.importorskip("laspy")
    (tmp_path / "a.las").write_bytes(las())
    expected = POINTS + np.array([500_000.0, 6_000_000.0, 0.0])
    np.testing.assert_allclose(read_cloud(tmp_path / "a.las").points_m, expected, atol=1e-9)


def test_laz_of_another_program_is_read(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    (tmp_path / "a.las").write_bytes(las())
    laspy.read(tmp_path / "a.las").write(tmp_path / "a.laz", do_compress=True)
    expected = POINTS + np.array([500_000.0, 6_000_000.0, 0.0])
    np.testing.assert_allclose(read_cloud(tmp_path / "a.laz").points_m, expected, atol=1e-9)


SURVEY_FOOT_M = 1200 / 3937
FEET_ACROSS = (
    'COMPD_CS["NAD83 / Oregon + NAVD88",PROJCS["NAD83 / Oregon",GEOGCS["NAD83",DATUM["d",SPHEROID['
    '"GRS",6378137,298.257]],UNIT["degree",0.0174532925199433]],PROJECTION["Lambert"],'
    'UNIT["US survey foot",0.3048006096012192]],VERT_CS["NAVD88",VERT_DATUM["v",2005],'
    'UNIT["metre",1]]]'
)


def test_feet_become_metres_and_a_line_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("laspy")
    (tmp_path / "a.las").write_bytes(las(feet=True))

    points = read_cloud(tmp_path / "a.las").points_m

    feet = POINTS + np.array([500_000.0, 6_000_000.0, 0.0])
    np.testing.assert_allclose(points, feet * SURVEY_FOOT_M, atol=1e-6)
    assert "a.las states units of 0.304801 m: its coordinates are converted" in caplog.text


def test_a_file_may_state_feet_across_and_metres_up(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    (tmp_path / "a.las").write_bytes(las())
    cloud = laspy.read(tmp_path / "a.las")
    cloud.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(FEET_ACROSS))
    cloud.write(tmp_path / "b.las")

    points = read_cloud(tmp_path / "b.las").points_m

    factors = [SURVEY_FOOT_M, SURVEY_FOOT_M, 1.0]
    feet = POINTS + np.array([500_000.0, 6_000_000.0, 0.0])
    np.testing.assert_allclose(points, feet * factors, atol=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('GEOGCS["WGS 84",UNIT["degree",0.0174532925199433]]', "are degrees: expected metres"),
        ('PROJCS["x",UNIT["kilometre",1000]]', "its unit is 1000 m: expected metres or feet"),
    ],
)
def test_degrees_and_odd_units_are_refused(text: str, words: str, tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    (tmp_path / "a.las").write_bytes(las())
    cloud = laspy.read(tmp_path / "a.las")
    cloud.header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(text))
    cloud.write(tmp_path / "b.las")
    with pytest.raises(InputError, match=rf"b\.las: .*{words}"):
        read_cloud(tmp_path / "b.las")


@pytest.mark.parametrize(
    ("per_metre", "words"),
    [(1.0, None), (1 / 0.3048, "likely feet"), (1000.0, "likely millimetres")],
)
def test_trees_that_are_too_tall_for_metres_are_told(
    per_metre: float, words: str | None, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 40, (2, 40_000))
    z = 0.4 * x + rng.uniform(0, 28, 40_000)  # a slope
    np.save(tmp_path / "a.npy", np.stack([x, y, z], -1) * per_metre)

    read_cloud(tmp_path / "a.npy")

    told = [record.getMessage() for record in caplog.records]
    assert len(told) == (words is not None)
    assert words is None or ("a.npy" in told[0] and words in told[0])


def test_lzf_repeats_bytes_that_it_appends() -> None:
    # "ab", then 6 bytes from 2 back: the short form, of length 4 + 2.
    assert decompress(bytes([1]) + b"ab" + bytes([4 << 5, 1]), 8) == b"abababab"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.ply", PLY_TEXT[:-40], "ends after 1 of 3 points"),
        ("a.ply", ply_binary("<")[:-1], "ends after 2 of 3 points"),
        ("a.ply", PLY_TEXT.replace(b"float z", b"float w"), "expected x, y and z"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "has no end: expected end_header"),
        ("a.ply", PLY_TEXT.replace(b"vertex 3", b"vertex 99999999999"), "limit cloud_points"),
        ("a.pcd", pcd_binary()[:-1], "ends after 2 of 3 points"),
        ("a.pcd", pcd_compressed()[:-3], "damaged or not complete"),
        ("a.pcd", pcd_binary().replace(b"POINTS 3", b"POINTS 99999999999"), "limit cloud_points"),
        ("a.pcd", pcd_binary().replace(b"SIZE 4 4", b"SIZE 3 4"), "the PCD field x has size 3"),
        ("a.bin", kitti()[:-1], "expected a multiple of 16"),
        ("a.bin", struct.pack("<4f", 1e30, 0, 0, 0), "1 of its 1 points are no places within"),
        ("a.npz", npz(("a", "b", "c")), r"it holds the arrays a \(3,\)"),
        ("a.npz", npz()[:60], "its archive cannot be read"),
        ("a.npy", npy("(9, 3)"), "cannot be read"),
        ("a.npy", npy("(9,)"), "has shape"),
        ("a.las", las()[:-1], "ends after 2 of 3 points"),
        ("a.las", b"LASF", "expected a LAS header"),
        ("a.ply", b"\x89PNG", "it is no point cloud, expected a point cloud as PLY"),
    ],
    # Data in the names of tests would differ between processes: archives hold the time.
    ids=lambda value: "" if isinstance(value, bytes) else value,
)
def test_what_is_wrong_is_said_in_one_line(
    name: str, data: bytes, words: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=words) as caught:
        read_cloud(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_short_text_is_told_by_its_line_alone(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    (tmp_path / "a.ply").write_bytes(PLY_TEXT[:-40])
    with pytest.raises(InputError, match="ends after 1 of 3 points"):
        read_cloud(tmp_path / "a.ply")
    assert not recwarn.list


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cloud .*a\.ply: no such file, expected a point cloud"):
        read_cloud(tmp_path / "a.ply")


def test_clouds_have_a_limit(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(kitti())
    (tmp_path / "a.pcd").write_bytes(pcd_binary())
    before = set_limits(replace(current_limits(), cloud_points=2))
    try:
        with pytest.raises(InputError, match="has 3 points: expected at most 2"):
            read_cloud(tmp_path / "a.bin")
        with pytest.raises(InputError, match="larger than 128 bytes"):
            read_cloud(tmp_path / "a.pcd")
    finally:
        set_limits(before)


def test_a_cloud_without_returns_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes(64))
    with pytest.raises(InputError, match="none of its 4 points has coordinates"):
        read_cloud(tmp_path / "a.bin")
