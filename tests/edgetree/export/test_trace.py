"""A traced graph gives the outputs of the model in onnxruntime."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch

from edgetree.export.build import offer_lowest_score, output_names, trace
from edgetree.model_file.manifest import SCORE_INPUT
from perceptree.models import TreeRCNN

BuildModel = Callable[..., TreeRCNN]


def frames(height: int, width: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(5)
    return torch.randint(0, 256, (2, height, width, 3), generator=random, dtype=torch.uint8)


def assert_same_outputs(model: TreeRCNN, every_row: bool = False) -> None:
    spec = model.spec
    images = frames(spec.height, spec.width)
    with torch.inference_mode():
        expected = model.detect(images)._asdict()
    assert int(expected["num_detections"].min()) > 1
    names = output_names(spec.masks, spec.keypoints)
    session = onnxruntime.InferenceSession(
        trace(model, batch=2, every_row=every_row).SerializeToString(),
        providers=["CPUExecutionProvider"],
    )
    assert tuple(output.name for output in session.get_outputs()) == names
    outputs = dict(zip(names, session.run(None, {"image": images.numpy()}), strict=True))
    assert outputs["num_detections"].tolist() == expected["num_detections"].tolist()
    tolerances = {
        "boxes": 0.02,
        "scores": 1e-4,
        "keypoints": 0.05,
        "keypoint_stds": 0.05,
        "masks": 1e-3,
    }
    for name in names[:-1]:
        theirs = expected[name].numpy()
        assert theirs.any(), name
        assert outputs[name].shape == theirs.shape
        assert np.abs(outputs[name] - theirs).max() < tolerances[name], name
    if spec.keypoints:
        np.testing.assert_allclose(
            outputs["keypoints"][..., 2], expected["keypoints"][..., 2].numpy(), atol=1e-4
        )


@pytest.mark.parametrize(
    ("masks", "keypoints"),
    [
        pytest.param(True, False, marks=pytest.mark.slow),
        pytest.param(False, True, marks=pytest.mark.slow),
        (False, False),
    ],
)
def test_a_network_with_some_branches_exports(
    masks: bool, keypoints: bool, build_model: BuildModel
) -> None:
    assert_same_outputs(build_model(preset="r50", masks=masks, keypoints=keypoints))


@pytest.mark.parametrize(("every_row", "mask_score_weight"), [(False, 0.0), (True, 0.7)])
def test_a_light_network_exports_with_rows_by_the_picture_or_all(
    every_row: bool, mask_score_weight: float, build_model: BuildModel
) -> None:
    assert_same_outputs(build_model(mask_score_weight=mask_score_weight), every_row)


def test_a_picture_without_a_box_beside_one_with_some(build_model: BuildModel) -> None:
    model = build_model()
    images = frames(model.spec.height, model.spec.width)
    with torch.inference_mode():
        best = model.detect(images).scores.amax(dim=1)
        low, high = best.sort().values.tolist()
        model.spec = dataclasses.replace(model.spec, score_threshold=(low + high) / 2)
        expected = model.detect(images)
    assert sorted(expected.num_detections.tolist())[0] == 0
    assert expected.num_detections.max() > 0
    session = onnxruntime.InferenceSession(
        trace(model, batch=2).SerializeToString(), providers=["CPUExecutionProvider"]
    )
    for given in (images, torch.zeros_like(images)):
        with torch.inference_mode():
            wanted = model.detect(given)
        outputs = session.run(None, {"image": given.numpy()})
        for ours, theirs in zip(outputs, wanted, strict=True):
            np.testing.assert_allclose(ours, theirs.numpy(), atol=0.05)


@pytest.mark.parametrize("mask_score_weight", [0.0, 0.7])
def test_a_wanted_score_leaves_rows_out_and_changes_no_others(
    mask_score_weight: float, build_model: BuildModel
) -> None:
    model = build_model(mask_score_weight=mask_score_weight)
    proto = trace(model, batch=2, quantised=True)
    offer_lowest_score(proto)
    session = onnxruntime.InferenceSession(
        proto.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    image = {"image": frames(model.spec.height, model.spec.width).numpy()}
    every = session.run(None, image)
    scores = every[1]
    wanted = np.sort(scores[scores > 0])[[5]]  # that of one tree, which stays
    chosen = session.run(None, image | {SCORE_INPUT: wanted})
    kept = scores >= wanted
    assert chosen[-1].tolist() == kept.sum(axis=1).tolist()
    assert chosen[-1].sum() < every[-1].sum()
    for ours, theirs in zip(chosen[:-1], every[:-1], strict=True):
        np.testing.assert_array_equal(ours[kept], theirs[kept])
        assert not ours[~kept].any()


def test_a_graph_that_computes_all_rows_takes_the_image_alone(
    build_model: BuildModel, traced: Callable[..., Any]
) -> None:
    proto = traced(build_model(), 2, every_row=True)
    assert [value.name for value in proto.graph.input] == ["image"]
    assert SCORE_INPUT not in [constant.name for constant in proto.graph.initializer]


@pytest.mark.slow
def test_the_whole_r50_network_exports_at_a_size_that_is_no_multiple_of_32(
    build_model: BuildModel,
) -> None:
    size = {"height": 90, "width": 150}
    assert_same_outputs(build_model(preset="r50", backbone="resnet50", stride_in_1x1=True, **size))
