"""Models on frames with ground truth: comparison, pictures, speed and report."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from edgetree.demo import demonstrate, write_report
from edgetree.demo.examine import examine
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import FakeSession
from edgetree.samples import SampleFrame, SampleTree

WIDTH, HEIGHT = 640, 384


def tree(x_px: float, distance_m: float) -> SampleTree:
    points_px = [(10, 250, 2), (0, 230, 2), (20, 230, 2), (0, 0, 0), (10, 130, 1)]
    return SampleTree(
        box_px=np.array([x_px, 50, x_px + 20, 310], np.float32),
        keypoints_px=np.array([(x_px + x, 50 + y, flag) for x, y, flag in points_px], np.float32),
        diameter_m=0.25,
        cut_height_m=0.2,
        distance_m=distance_m,
        inclination_deg=1.0,
        visible_fraction=0.9,
        species="fir",
    )


@pytest.fixture
def frames(tmp_path: Path) -> list[SampleFrame]:
    """Three frames with two trees each; the far tree is listed first."""
    found = []
    for number in range(3):
        image_path, depth_path = tmp_path / f"{number}.jpg", tmp_path / f"{number}.png"
        cv2.imwrite(str(image_path), np.full((HEIGHT, WIDTH, 3), 60 + number, np.uint8))
        calib.write_depth(depth_path, np.full((HEIGHT, WIDTH), 8.0, np.float32))
        found.append(
            SampleFrame(
                name=str(number),
                image_path=image_path,
                depth_path=depth_path,
                camera=calib.PinholeCamera(WIDTH, HEIGHT, 500.0, 500.0, 319.5, 191.5),
                up_camera=np.array([0.0, -1.0, 0.0]),
                trees=(tree(500.0, 9.0), tree(101.0, 5.0)),
            )
        )
    return found


def test_detections_get_the_numbers_of_their_trees_from_near_to_far(
    frames: list[SampleFrame],
    depth_manifest: Manifest,
    two_trees: dict[str, NDArray[np.float32]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[list[str]] = []

    def draw(picture: object, trees: object, labels: list[list[str]], **more: object) -> object:
        drawn.extend(labels)
        return picture

    monkeypatch.setattr("edgetree.demo.examine.draw_trees", draw)
    session = FakeSession.with_trees(depth_manifest, **two_trees)
    detector = TreeDetector(session, score_threshold=0.2)
    comparison = examine(detector, frames[0])
    assert [tree.truth.distance_m for tree in comparison.trees] == [5.0, 9.0]
    assert [tree.found for tree in comparison.trees] == [True, False]
    assert comparison.trees[0].score == pytest.approx(0.9)
    assert comparison.unmatched_detections == 1
    assert [lines[0].split()[0] for lines in drawn] == ["1", "?"]
    picture = comparison.picture
    assert picture is not None
    decoded = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape == (HEIGHT, WIDTH, 3)
    assert (picture.width_px, picture.height_px) == (WIDTH, HEIGHT)


def test_each_model_gets_its_kind_of_image(
    frames: list[SampleFrame], rgb_manifest: Manifest, depth_manifest: Manifest
) -> None:
    for manifest, expected in ((rgb_manifest, 60), (depth_manifest, round(8 / 20 * 255))):
        session = FakeSession.with_trees(manifest, np.zeros((0, 4)), np.zeros(0))
        examine(TreeDetector(session), frames[0])
        assert int(session.inputs["image"].flat[0]) == pytest.approx(expected, abs=1)


def test_a_demonstration_contains_all_models_and_frames(
    frames: list[SampleFrame],
    tmp_path: Path,
    rgb_manifest: Manifest,
    depth_manifest: Manifest,
    write_model: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("edgetree.demo.running._BENCH_S", 0.05)
    models = [write_model(depth_manifest, "depth.onnx"), write_model(rgb_manifest, "rgb.onnx")]
    told: list[float] = []
    result = demonstrate(models, frames, lambda share, what: told.append(share))
    assert [model.manifest.modality for model in result.models] == ["depth", "rgb"]
    assert [(m.found_trees, m.true_trees) for m in result.models] == [(3, 6), (3, 6)]
    speeds = [model.speed for model in result.models]
    assert all(0.0 < speed.detect_p50_ms <= speed.detect_p90_ms for speed in speeds)
    for model in result.models:
        assert [each.frame for each in model.frames] == [frame.name for frame in frames]
        assert all(each.picture is not None for each in model.frames)
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] == pytest.approx(1.0)

    report = write_report(tmp_path, result, [])
    assert report == tmp_path / "report.html"
    assert report.read_text("utf-8").count("data:image/jpeg;base64,") == 6


def test_a_report_that_cannot_be_written_leaves_no_files(
    frames: list[SampleFrame],
    tmp_path: Path,
    depth_manifest: Manifest,
    write_model: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("edgetree.demo.running._BENCH_S", 0.0)
    result = demonstrate([write_model(depth_manifest)], frames[:1], lambda share, what: None)
    (tmp_path / "out" / "report.html").mkdir(parents=True)
    with pytest.raises(InputError, match=r"report\.html is a folder"):
        write_report(tmp_path / "out", result, [])
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["report.html"]
