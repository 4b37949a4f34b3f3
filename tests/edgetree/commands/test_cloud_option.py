"""A scan beside a picture, by `--cloud` and `--extrinsic`, and mistakes about them."""

import json
import re

import numpy as np
import pytest

from calib import RigidTransform, depth_to_points, save_camera, save_transform
from edgetree import sample_frames


@pytest.fixture
def scan(tmp_path):
    """A sample's depth as a scanner's points, with its camera and transform; the options."""
    sample = sample_frames()[0]
    points = depth_to_points(sample.camera, sample.depth_m())[::18, ::4].reshape(-1, 3)
    scanner = RigidTransform([[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0.0, -0.2, 0.0])
    np.savez(tmp_path / "scan.npz", points=scanner.inverse().apply(points[points[:, 2] > 0]))
    save_camera(tmp_path / "camera.json", sample.camera)
    save_transform(tmp_path / "extrinsic.json", scanner)
    save_transform(tmp_path / "inverse.json", scanner.inverse())
    up = ",".join(map(str, sample.up_camera))
    return [str(sample.image_path), "--camera", str(tmp_path / "camera.json"), f"--up={up}"]


def test_a_scan_beside_a_picture_gives_diameters(run_cli, scan, tmp_path):
    files = ("--cloud", tmp_path / "scan.npz", "--extrinsic", tmp_path / "extrinsic.json")
    done = run_cli("measure", *scan, *files, "--threads", 1, "--json")
    assert done.code == 0, done.err
    trees = json.loads(done.out)["frame"]["trees"]
    found = [tree["metres"]["diameter_m"] for tree in trees if "diameter_m" in tree["metres"]]
    true = [tree.diameter_m for tree in sample_frames()[0].trees]
    assert len(found) >= 3
    near = [min(abs(value - each) for each in true) < 0.05 for value in found]
    assert sum(near) >= 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--cloud", "scan.npz"], "without --extrinsic: expected both"),
        (
            ["--cloud", "none.pcd", "--extrinsic", "extrinsic.json"],
            "none.pcd does not exist",
        ),
        (["--cloud", "scan.npz", "--extrinsic", "inverse.json"], "turn it round"),
        (["--cloud", "scan.npz", "--depth", "scan.npz"], "--cloud given with --depth"),
        (["--cloud", "camera.json", "--extrinsic", "extrinsic.json"], "json is of another kind"),
        (["--cloud", "scan.npz", "--camera-height", "1_6"], "expected one way to distances"),
        (["--camera-height", "1_6", "--extrinsic", "extrinsic.json"], "given without --cloud"),
    ],
)
def test_mistakes_are_said_in_one_line(run_cli, scan, options, words, tmp_path):
    paths = [tmp_path / each if "." in each else each.replace("_", ".") for each in options]
    done = run_cli("measure", *scan, *paths)
    assert done.code == 2
    assert re.search(words, done.err), done.err
    assert "Traceback" not in done.err
