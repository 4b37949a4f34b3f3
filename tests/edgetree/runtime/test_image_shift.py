"""Pictures that are unlike those of the training are told, ordinary ones are not."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib import DepthEncoding, picture_statistics
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.catalogue import DEFAULTS, KnownModel
from edgetree.detections import UnlikeTraining
from edgetree.model_file.manifest import Manifest, UsualRange
from edgetree.runtime.image_shift import unlike_training, what_helps
from edgetree.runtime.session import FakeSession

Cli = Callable[..., Any]
Write = Callable[..., Path]


def colour(name: str) -> NDArray[np.uint8]:
    """A strange colour picture."""
    rng = np.random.default_rng(0)
    image = np.full((360, 640, 3), 128, np.uint8)
    if name == "noise":
        image = rng.integers(0, 256, image.shape, np.uint8)
    elif name == "night":
        image = np.clip(rng.normal(3, 2, image.shape), 0, 255).astype(np.uint8)
    elif name == "room":
        image[:], image[250:] = (200, 210, 215), (90, 120, 160)
        cv2.rectangle(image, (380, 80), (560, 230), (250, 240, 230), -1)
        cv2.rectangle(image, (60, 150), (260, 300), (60, 70, 110), -1)
        cv2.rectangle(image, (280, 60), (340, 330), (120, 150, 190), -1)
        noisy = np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        image = np.asarray(cv2.GaussianBlur(noisy, (0, 0), 1), np.uint8)
    return image


def found_by(manifest: Manifest, image: NDArray[Any]) -> UnlikeTraining | None:
    """What a detector with this manifest tells of an image."""
    session = FakeSession.with_trees(
        manifest,
        np.zeros((0, 4), np.float32),
        np.zeros(0, np.float32),
        np.zeros((0, 5, 3), np.float32),
        np.zeros((0, 28, 28), np.float32),
    )
    return TreeDetector(session).detect(image).unlike


def shipped(modality: str) -> Manifest:
    """The manifest of an embedded file."""
    return KnownModel(modality, default_model(modality)).manifest()


@pytest.mark.parametrize(
    ("name", "statistics"),
    [
        ("grey", {"contrast"}),
        ("night", {"black_percent"}),
        ("room", {"texture", "local_contrast"}),
    ],
)
def test_strange_colours_are_told(name: str, statistics: set[str]) -> None:
    found = found_by(shipped("rgb"), colour(name))
    assert found is not None
    assert found.statistic in statistics


def far(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """A wrong unit, by a factor that leaves possible distances."""
    return np.minimum(depth_m * 10, 50.0)


def flat(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """A wall."""
    return np.full_like(depth_m, 5.0)


@pytest.mark.parametrize(("change", "statistic"), [(far, "reading_percent"), (flat, "spread_m")])
def test_strange_depth_is_told(change: Callable[..., Any], statistic: str) -> None:
    found = found_by(shipped("depth"), change(next(iter(sample_frames())).depth_m()))
    assert found is not None
    assert found.statistic == statistic


def test_the_sample_frames_are_ordinary() -> None:
    for modality in ("rgb", "depth"):
        manifest = shipped(modality)
        for sample in sample_frames():
            image = sample.depth_m() if modality == "depth" else sample.image()
            assert found_by(manifest, image) is None


def test_padding_does_not_count(rgb_manifest: Manifest) -> None:
    only = (UsualRange("lightness", 190, 210),)
    manifest = dataclasses.replace(rgb_manifest, training_pictures=only)
    assert found_by(manifest, np.full((400, 50, 3), 200, np.uint8)) is None


def test_a_file_without_ranges_tells_nothing(rgb_manifest: Manifest) -> None:
    text = json.loads(rgb_manifest.to_json())
    del text["training_pictures"]
    older = Manifest.from_json(json.dumps(text))
    assert older == rgb_manifest
    assert found_by(older, colour("grey")) is None


def test_the_farthest_statistic_is_told_and_unknown_ones_are_left_out() -> None:
    ranges = (UsualRange("lightness", 50, 100), UsualRange("contrast", 20, 40))
    statistics = {"lightness": 130.0, "contrast": 20.0, "of_a_newer_version": 9.0}
    newer = (*ranges, UsualRange("of_a_newer_version", 0, 1))
    found = unlike_training(statistics, newer)
    assert found is not None
    assert str(found) == "mean lightness is 130 grey levels, usually 50 to 100"
    assert unlike_training(statistics | {"lightness": 124.0}, newer) is None
    worse = unlike_training(statistics | {"contrast": 0.1}, newer)
    assert worse is not None
    assert worse.statistic == "contrast"


def test_a_program_is_told_what_to_try() -> None:
    detector = TreeDetector.load("edge-n-depth", threads=1, score_threshold=0.3)
    found = detector.detect(flat(sample_frames()[0].depth_m())).unlike
    assert found is not None
    assert found.advice == (
        "try --model edge-s-depth, a --score-threshold below 0.3,"
        " or fine-tuning (docs/guides/fine-tune.md)"
    )


@pytest.mark.parametrize("used", ["edge-n-rgb", "edge-s-rgb"])
def test_the_advice_names_another_model_for_the_same_images(used: str) -> None:
    (other,) = {"edge-n-rgb", "edge-s-rgb"} - {used}
    assert what_helps("rgb", used, 0.01) == (
        f"try --model {other}, or fine-tuning (docs/guides/fine-tune.md)"
    )
    assert (Path(__file__).parents[3] / "docs/guides/fine-tune.md").is_file()


def test_run_says_it_once_and_in_the_record(
    run_cli: Cli, images: Path, write_model: Write, rgb_manifest: Manifest
) -> None:
    cv2.imwrite(str(images / "b.jpg"), np.full((360, 640, 3), 128, np.uint8))
    ranges = (UsualRange("contrast", 50, 90),)
    model = write_model(dataclasses.replace(rgb_manifest, training_pictures=ranges))
    page = images.parent / "report.html"
    done = run_cli("run", images, "--model", model, "--json", "--report", page)
    assert done.code == 0, done.err
    first, second = json.loads(done.out)["frames"]
    assert "unlike_training" not in first
    record = second["unlike_training"]
    assert (record["statistic"], record["usual"], record["unit"]) == (
        "contrast",
        [50, 90],
        "grey levels",
    )
    assert record["value"] < 2
    advice = "a --score-threshold below 0.5, or fine-tuning (docs/guides/fine-tune.md)"
    assert record["advice"] == f"try --model {DEFAULTS['rgb']}, {advice}"
    told = [line for line in done.err.splitlines() if "unlike the training pictures" in line]
    assert len(told) == 1
    assert "1 of 2 frames unlike the training pictures, the first: b: contrast is" in told[0]
    assert told[0].endswith(f"usually 50 to 90; {record['advice']}")
    assert page.read_text(encoding="utf-8").count("unlike the training pictures") >= 1


def test_measure_says_it_too(
    run_cli: Cli, images: Path, write_model: Write, depth_manifest: Manifest
) -> None:
    folder = images.parent
    ranges = (UsualRange("spread_m", 2.0, 9.0),)
    model = write_model(dataclasses.replace(depth_manifest, training_pictures=ranges))
    files = ("--depth", folder / "depth/a.png", "--camera", folder / "camera.json")
    done = run_cli("measure", images / "a.jpg", *files, "--model", model)
    assert done.code == 0, done.err
    (told,) = [line for line in done.err.splitlines() if "unlike the training pictures" in line]
    assert "unlike the training pictures: a: spread of the depth is 0" in told
    assert f"usually 2 to 9; try --model {DEFAULTS['depth']}, a --score-threshold below" in told


def test_the_embedded_files_know_how_their_pictures_look() -> None:
    for modality, encoding in (("rgb", None), ("depth", DepthEncoding())):
        image = np.random.default_rng(0).integers(0, 250, (64, 64, 3), np.uint8)
        names = picture_statistics(image if encoding is None else image[..., 0].copy(), encoding)
        assert {each.statistic for each in shipped(modality).training_pictures} == set(names)
