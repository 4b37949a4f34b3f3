"""The line of a frame for people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.measure import Estimate, TreeMeasurement
from edgetree.results.frame_line import frame_line

UNMEASURED = TreeMeasurement.failed("no depth on the stem")


def line(diameters_m: list[float | None], *, measured: bool = True) -> str:
    count = len(diameters_m)
    trees = TreeDetections(
        boxes_px=np.zeros((count, 4), np.float32),
        scores=np.ones(count, np.float32),
        keypoints_px=None,
        masks=None,
        image_width=64,
        image_height=48,
    )
    values = [
        UNMEASURED if value is None else replace(UNMEASURED, diameter_m=Estimate(value, 0.008))
        for value in diameters_m
    ]
    found = FoundTrees.detected(trees)
    return frame_line(
        FrameResult(Frame("a", None, None), found, values if measured else None, None)
    )


@pytest.mark.parametrize(
    ("diameters_m", "words"),
    [
        ([], "a: 0 trees"),
        ([None], "a: 1 tree, no diameter"),
        ([0.312], "a: 1 tree, diameter 31.2 ± 0.8 cm"),
        ([0.312, None], "a: 2 trees, 1 measured, diameter 31.2 ± 0.8 cm"),
        ([0.312, 0.15, 0.2], "a: 3 trees, diameters 15 to 31 cm"),
        ([0.312, None, 0.2], "a: 3 trees, 2 measured, diameters 20 to 31 cm"),
    ],
)
def test_a_line_tells_the_trees_and_their_diameters(
    diameters_m: list[float | None], words: str
) -> None:
    assert line(diameters_m) == words


def test_without_metres_it_tells_the_number_alone() -> None:
    assert line([None, None], measured=False) == "a: 2 trees"
