"""The detector with real sessions: batches, threads and invalid outputs."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from edgetree import sample_frames
from edgetree.detections import TreeDetections
from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import Manifest
from edgetree.runtime import TreeDetector, default_model
from edgetree.runtime.session import Arrays, FakeSession

Trees = dict[str, NDArray[np.float32]]


class _Counting(FakeSession):
    """Finds one tree in each image; its box's left edge is the image's first byte.

    `sizes` are the numbers of images that went in at once.
    """

    def __init__(self, manifest: Manifest, batch: int | str = "batch") -> None:
        super().__init__(manifest, self._outputs_for)
        self.sizes: list[int] = []
        self._batch = batch

    @property
    def input_shapes(self) -> dict[str, tuple[int | str, ...]]:
        return {"image": (self._batch, *self.manifest.input.image_shape)}

    def _outputs_for(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        images = inputs["image"]
        self.sizes.append(len(images))
        outputs: dict[str, NDArray[Any]] = {
            output.name: np.zeros((len(images), *map(int, output.shape[1:])), output.dtype)
            for output in self.manifest.outputs
        }
        outputs["boxes"][:, 0] = np.stack([(image[0, 0, 0], 0, 300, 300) for image in images])
        outputs["scores"][:, 0] = 0.9
        outputs["num_detections"][:] = 1
        return outputs


def _images(count: int) -> list[NDArray[np.uint8]]:
    """Images of different sizes; all values of image i are i + 1."""
    return [np.full((96 + index, 160 + index, 3), index + 1, np.uint8) for index in range(count)]


def _firsts(found: list[TreeDetections]) -> list[int]:
    """The first byte of each image, decoded from the box that `_Counting` returns."""
    scales = [640 / trees.image_width for trees in found]
    return [
        round(float(trees.boxes_px[0, 0]) * scale)
        for trees, scale in zip(found, scales, strict=True)
    ]


@pytest.mark.parametrize(
    ("batch_sizes", "count", "runs"),
    [((1,), 3, [1, 1, 1]), ((1, 4), 6, [4, 1, 1]), ((1, 2, 4), 7, [4, 2, 1]), ((1, 4), 0, [])],
)
def test_batches_have_the_verified_sizes(
    rgb_manifest: Manifest, batch_sizes: tuple[int, ...], count: int, runs: list[int]
) -> None:
    taken = dataclasses.replace(rgb_manifest.input, batch_sizes=batch_sizes)
    session = _Counting(dataclasses.replace(rgb_manifest, input=taken))
    found = TreeDetector(session).detect_batch(_images(count))
    assert _firsts(found) == list(range(1, count + 1))
    assert [trees.image_width for trees in found] == [160 + index for index in range(count)]
    assert session.sizes == runs


@pytest.mark.parametrize(("count", "runs"), [(1, [4]), (3, [4]), (4, [4]), (6, [4, 4])])
def test_incomplete_fixed_batches_are_filled_up(
    rgb_manifest: Manifest, count: int, runs: list[int]
) -> None:
    session = _Counting(rgb_manifest, batch=4)
    detector = TreeDetector(session)
    assert _firsts(detector.detect_batch(_images(count))) == list(range(1, count + 1))
    assert session.sizes == runs
    filled = session.inputs["image"][count % 4 or 4 :]
    assert (filled == 114).all()
    assert _firsts([detector.detect(_images(1)[0])]) == [1]


def test_a_model_of_batch_size_four_takes_any_number_of_images(
    rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    detector = TreeDetector.load(write_model(rgb_manifest, batch=4), threads=1)
    assert [len(trees) for trees in detector.detect_batch(_images(5))] == [1] * 5
    assert len(detector.detect(_images(1)[0])) == 1


def _same(a: TreeDetections, b: TreeDetections) -> None:
    assert len(a) == len(b)
    for name in ("boxes_px", "scores", "keypoints_px", "masks"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_several_threads_may_share_a_detector() -> None:
    detector = TreeDetector.load(default_model("depth"), threads=1, score_threshold=0.05)
    images = [frame.depth_m() for frame in sample_frames()[:4]]
    images += [image[::2, ::2] for image in images]
    alone = [detector.detect(image) for image in images]
    assert sum(map(len, alone)) > 0
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(detector.detect, images * 2))
    for expected, found in zip(alone * 2, together, strict=True):
        _same(expected, found)
    for expected, found in zip(alone, detector.detect_batch(images), strict=True):
        _same(expected, found)


def test_warming_up_runs_the_model(rgb_manifest: Manifest) -> None:
    session = _Counting(rgb_manifest)
    detector = TreeDetector(session)
    detector.warm_up(rounds=3)
    assert session.sizes == [1, 1, 1]
    assert _firsts(detector.detect_batch(_images(2))) == [1, 2]


def _spoilt(name: str, change: Callable[[NDArray[Any]], Any]) -> Any:
    def answer(outputs: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        changed = change(outputs[name].copy())
        if changed is None:
            return {key: values for key, values in outputs.items() if key != name}
        return {**outputs, name: changed}

    return answer


def _put(value: float) -> Callable[[NDArray[Any]], NDArray[Any]]:
    def change(values: NDArray[Any]) -> NDArray[Any]:
        values[0, ...].flat[0] = value
        return values

    return change


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            _spoilt("boxes", _put(np.nan)),
            "gave boxes with NaN or infinity: expected finite numbers",
        ),
        (_spoilt("masks", _put(np.inf)), "gave masks with NaN or infinity"),
        (_spoilt("keypoints", _put(-np.inf)), "gave keypoints with NaN or infinity"),
        (_spoilt("scores", _put(1.5)), r"gave scores of 0\.3 to 1\.5: expected 0 to 1"),
        (_spoilt("scores", lambda values: None), r"gave scores as missing: expected float32"),
        (_spoilt("boxes", lambda values: values[:, :3]), r"gave boxes as float32 \(1, 3, 4\)"),
        (_spoilt("boxes", lambda values: values.astype("f8")), r"gave boxes as float64"),
        (_spoilt("num_detections", lambda values: values + 99), "gave 101 detections: expected 0"),
        (_spoilt("num_detections", lambda values: -values), "gave -2 detections: expected 0 to 20"),
    ],
)
def test_invalid_outputs_are_an_error_and_the_detector_stays_usable(
    rgb_manifest: Manifest, two_trees: Trees, spoil: Any, message: str
) -> None:
    outputs = FakeSession.with_trees(rgb_manifest, **two_trees).run({})
    broken = [True]
    session = FakeSession(rgb_manifest, lambda _: spoil(outputs) if broken[0] else outputs)
    detector = TreeDetector(session)
    with pytest.raises(ModelFileError, match=f"model test-rgb {message}") as caught:
        detector.detect(_images(1)[0])
    assert "\n" not in str(caught.value)
    broken[0] = False
    assert len(detector.detect(_images(1)[0])) == 1


def test_scores_slightly_outside_the_range_are_clipped(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    two_trees["scores"][:] = 1.0001, -0.0001
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    trees = TreeDetector(session, score_threshold=0.0).detect(_images(1)[0])
    assert trees.scores.tolist() == [1.0, 0.0]


def test_unused_rows_may_contain_any_values(rgb_manifest: Manifest, two_trees: Trees) -> None:
    outputs = FakeSession.with_trees(rgb_manifest, **two_trees).run({})
    outputs["boxes"][0, 2:] = np.nan
    trees = TreeDetector(FakeSession(rgb_manifest, outputs)).detect(_images(1)[0])
    assert len(trees) == 1


_WATCHED = """
import json, sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
import numpy as np
from edgetree import TreeDetector
detector = TreeDetector.load(sys.argv[1], threads=1)
detector.detect(np.zeros((720, 1280), np.float32)).above(0.5)
print(json.dumps(opened))
"""


def test_only_the_model_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "alone" / "trees.onnx"
    path.parent.mkdir()
    shutil.copy(default_model("depth"), path)
    done = subprocess.run(
        [sys.executable, "-c", _WATCHED, path],
        cwd=path.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    opened = [Path(name) for name in json.loads(done.stdout)]
    assert path in opened
    assets = default_model("depth").parents[1]
    strangers = [name for name in opened if assets in name.parents or name.suffix == ".onnx"]
    assert set(strangers) == {path}
    assert list(path.parent.iterdir()) == [path]
