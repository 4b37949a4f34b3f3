"""Manifests that the tests of this folder share."""

from __future__ import annotations

import dataclasses

import pytest

from edgetree.detections import KEYPOINT_NAMES
from edgetree.manifest import (
    Manifest,
    ResizeRule,
    Thresholds,
    standard_input,
    standard_outputs,
)


@pytest.fixture
def rgb_manifest() -> Manifest:
    """An RGB model of 640x384 pixels that keeps 20 detections."""
    return Manifest(
        name="test-rgb",
        backbone="none",
        modality="rgb",
        input=standard_input("rgb", 384, 640),
        resize=ResizeRule(pad_value=114),
        mean=(103.5, 116.3, 123.7),
        std=(57.4, 57.1, 58.4),
        depth_encoding=None,
        outputs=standard_outputs(20),
        classes=("tree",),
        keypoint_names=KEYPOINT_NAMES,
        keypoint_flip_pairs=((1, 2),),
        thresholds=Thresholds(score=0.01, nms_iou=0.5),
        precision="float32",
        opset=18,
        parameters=1234,
        weights_sha256="0" * 64,
        training_data="none",
        project_version="0.1.0",
        parity={"frames": 20, "box_px": 0.01},
    )


@pytest.fixture
def depth_manifest(rgb_manifest: Manifest) -> Manifest:
    """A depth model like `rgb_manifest`."""
    return dataclasses.replace(
        rgb_manifest,
        name="test-depth",
        modality="depth",
        input=standard_input("depth", 384, 640),
        resize=ResizeRule(pad_value=255),
        mean=(127.5,),
        std=(60.0,),
        depth_encoding={
            "near_m": 0.0,
            "far_m": 20.0,
            "near_value": 0,
            "far_value": 255,
            "invalid_value": 255,
        },
        training_data="none",
    )
