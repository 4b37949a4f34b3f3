"""Models over frames on disk: what was found, against the truth, drawn and benched."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import calib
from edgetree.demo import demonstrate, write_report
from edgetree.demo.examine import examine
from edgetree.demo.held_out import held_out_frames
from edgetree.errors import InputError
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import FakeSession

WIDTH, HEIGHT = 640, 384


def annotation(image_id: int, x_px: float, distance_m: float) -> dict[str, object]:
    return {
        "image_id": image_id,
        "bbox": [x_px, 50.0, 20.0, 260.0],
        "keypoints": [
            x_px + 10,
            300,
            2,
            x_px,
            280,
            2,
            x_px + 20,
            280,
            2,
            0,
            0,
            0,
            x_px + 10,
            180,
            1,
        ],
        "diameter_m": 0.25,
        "cut_height_m": 0.2,
        "distance_m": distance_m,
        "inclination_deg": 1.0,
        "visible_fraction": 0.9,
        "species": "fir",
    }


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A dataset of three frames as the simulator writes them; the far tree is listed first."""
    camera = calib.PinholeCamera(WIDTH, HEIGHT, 500.0, 500.0, 319.5, 191.5)
    images, annotations = [], []
    for number in range(3):
        for folder in ("images", "depth"):
            (tmp_path / folder).mkdir(exist_ok=True)
        picture = np.full((HEIGHT, WIDTH, 3), 60 + number, np.uint8)
        cv2.imwrite(str(tmp_path / f"images/{number:06d}.jpg"), picture)
        depth_m = np.full((HEIGHT, WIDTH), 8.0, np.float32)
        calib.write_depth(tmp_path / f"depth/{number:06d}.png", depth_m)
        images.append(
            {
                "id": number,
                "file_name": f"images/{number:06d}.jpg",
                "depth_file": f"depth/{number:06d}.png",
                "camera": camera.to_dict(),
                "up_camera": [0.0, -1.0, 0.0],
            }
        )
        annotations += [annotation(number, 500.0, 9.0), annotation(number, 101.0, 5.0)]
    coco = {"images": images, "annotations": annotations}
    (tmp_path / "test_RGB.json").write_text(json.dumps(coco))
    return tmp_path


def test_frames_of_a_dataset_come_in_memorys_convention(data: Path) -> None:
    frames = held_out_frames(data, "test", 2)
    assert [frame.name for frame in frames] == ["000000", "000002"]
    assert len(held_out_frames(data, "test", 9)) == 3
    near = frames[0].trees[1]
    assert near.box_px.tolist() == [101.0, 50.0, 121.0, 310.0]
    assert near.keypoints_px[0].tolist() == [111.5, 300.5, 2.0]
    assert near.keypoints_px[3].tolist() == [0.0, 0.0, 0.0]
    assert frames[0].image().shape == (HEIGHT, WIDTH, 3)
    assert frames[0].depth_m()[0, 0] == 8.0


@pytest.mark.parametrize("content", [None, "{", "{}", '{"images": [{"id": 1}], "annotations": []}'])
def test_a_dataset_that_is_none_is_named(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "test_RGB.json").write_text(content)
    with pytest.raises(InputError, match=r"test_RGB\.json cannot be used"):
        held_out_frames(tmp_path, "test", 6)


def test_what_a_model_finds_is_numbered_as_the_truth_from_near_to_far(
    data: Path,
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
    comparison, picture = examine(detector, held_out_frames(data, "test", 1)[0])
    assert [tree.truth.distance_m for tree in comparison.trees] == [5.0, 9.0]
    assert [tree.found for tree in comparison.trees] == [True, False]
    assert comparison.trees[0].score == pytest.approx(0.9)
    assert comparison.unmatched_detections == 1
    assert [lines[0].split()[0] for lines in drawn] == ["1", "?"]
    assert picture.modality == "depth"
    decoded = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape == (HEIGHT, WIDTH, 3)
    assert (picture.width_px, picture.height_px) == (WIDTH, HEIGHT)


def test_a_depth_model_is_shown_metres_and_a_colour_model_the_picture(
    data: Path, rgb_manifest: Manifest, depth_manifest: Manifest
) -> None:
    (frame,) = held_out_frames(data, "test", 1)
    for manifest, expected in ((rgb_manifest, 60), (depth_manifest, round(8 / 20 * 255))):
        session = FakeSession.with_trees(manifest, np.zeros((0, 4)), np.zeros(0))
        examine(TreeDetector(session), frame)
        assert int(session.inputs["image"].flat[0]) == pytest.approx(expected, abs=1)


def test_a_demonstration_holds_every_model_and_frame(
    data: Path,
    rgb_manifest: Manifest,
    depth_manifest: Manifest,
    write_model: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("edgetree.demo.running._BENCH_S", 0.05)
    models = [write_model(depth_manifest, "depth.onnx"), write_model(rgb_manifest, "rgb.onnx")]
    told: list[float] = []
    frames = held_out_frames(data, "test", 3)
    result = demonstrate(models, frames, lambda share, what: told.append(share))
    assert [model.modality for model in result.models] == ["depth", "rgb"]
    assert [(m.found_trees, m.true_trees) for m in result.models] == [(3, 6), (3, 6)]
    assert all(0.0 < m.speed.p50_ms <= m.speed.p90_ms for m in result.models)
    assert {(p.frame, p.modality) for p in result.pictures} == {
        (frame.name, modality) for frame in frames for modality in ("depth", "rgb")
    }
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] == pytest.approx(1.0)

    report = write_report(data, result, [])
    assert report == data / "report.html"
    assert report.read_text("utf-8").count("data:image/jpeg;base64,") == 6


def test_a_report_that_cannot_be_written_leaves_nothing(
    data: Path,
    depth_manifest: Manifest,
    write_model: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("edgetree.demo.running._BENCH_S", 0.0)
    frames = held_out_frames(data, "test", 1)
    result = demonstrate([write_model(depth_manifest)], frames, lambda share, what: None)
    (data / "out" / "report.html").mkdir(parents=True)
    with pytest.raises(InputError, match=r"report\.html is a folder"):
        write_report(data / "out", result, [])
    assert [path.name for path in (data / "out").iterdir()] == ["report.html"]
