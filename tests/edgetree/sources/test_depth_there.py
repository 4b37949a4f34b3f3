"""The model that suits a source."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from edgetree.catalogue import DEFAULTS
from edgetree.samples import sample_frames
from edgetree.sources import model_for

DRIVE = Path(__file__).parents[3] / "edgetree/assets/drive"


@pytest.mark.parametrize(
    ("source", "modality"),
    [
        ("walk.mp4", "rgb"),
        ("0", "rgb"),
        ("/dev/video2", "rgb"),
        ("rtsp://camera/1", "rgb"),
        ("realsense", "depth"),
        ("oak", "depth"),
        ("orbbec", "depth"),
        (DRIVE, "depth"),
        (sample_frames()[0].image_path, "rgb"),
        (sample_frames()[0].image_path.parent, "rgb"),
    ],
)
def test_the_model_is_for_what_the_source_has(source: Path | str, modality: str) -> None:
    assert model_for(source) == DEFAULTS[modality]


def test_depth_beside_a_picture_and_depth_alone_are_for_the_depth_model(tmp_path: Path) -> None:
    sample = sample_frames()[0]
    assert model_for(sample.image_path, sample.depth_path) == DEFAULTS["depth"]
    assert model_for(sample.image_path, None, None) == DEFAULTS["rgb"]
    np.save(tmp_path / "a.npy", sample.depth_m())
    assert model_for(tmp_path / "a.npy") == DEFAULTS["depth"]
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    (tmp_path / "rgb/a.jpg").write_bytes(sample.image_path.read_bytes())
    (tmp_path / "depth/a.png").write_bytes(sample.depth_path.read_bytes())
    (tmp_path / "a.npy").unlink()
    assert model_for(tmp_path) == DEFAULTS["depth"]
