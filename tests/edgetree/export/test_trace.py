"""The paper's layout as an ONNX graph: onnxruntime answers as the model does."""

import numpy as np
import onnxruntime
import pytest
import torch

from edgetree.export.graph import output_names, trace
from perceptree.models import TreeRCNN, make_spec


def lively_paper_model(height: int, width: int, **changes: object) -> TreeRCNN:
    """A narrow network of the paper's layout whose scores and heat maps have clear peaks."""
    narrow: dict[str, object] = {
        "backbone": "resnet18",
        "stride_in_1x1": False,
        "fpn_width": 16,
        "box_head_width": 32,
        "mask_head_widths": (16, 16),
        "keypoint_head_widths": (16, 16),
        "proposals_per_level": 50,
        "proposals": 50,
        "detections": 6,
    }
    torch.manual_seed(1)
    model = TreeRCNN(make_spec("r50", "rgb", height, width, **(narrow | changes)))
    with torch.no_grad():
        for _ in range(20):  # gives batch norm the statistics that training would
            model.backbone(model.normalise(frames(height, width)))
        model.proposer.objectness.weight.mul_(100)
        model.box_head.score.weight.mul_(10)
        if model.keypoint_head is not None:
            model.keypoint_head.tower.up.weight.mul_(100)
        if model.mask_head is not None:
            model.mask_head.score.weight.mul_(20)
    return model.eval()


def frames(height: int, width: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(5)
    return torch.randint(0, 256, (2, height, width, 3), generator=random, dtype=torch.uint8)


def assert_same_answers(model: TreeRCNN) -> None:
    spec = model.spec
    images = frames(spec.height, spec.width)
    with torch.inference_mode():
        expected = model.detect(images)._asdict()
    assert int(expected["num_detections"].min()) > 1
    names = output_names(spec.masks, spec.keypoints)
    session = onnxruntime.InferenceSession(
        trace(model, batch=2).SerializeToString(), providers=["CPUExecutionProvider"]
    )
    assert tuple(output.name for output in session.get_outputs()) == names
    answers = dict(zip(names, session.run(None, {"image": images.numpy()}), strict=True))
    assert answers["num_detections"].tolist() == expected["num_detections"].tolist()
    tolerances = {"boxes": 0.02, "scores": 1e-4, "keypoints": 0.05, "masks": 1e-3}
    for name in names[:-1]:
        theirs = expected[name].numpy()
        assert theirs.any(), name
        assert answers[name].shape == theirs.shape
        assert np.abs(answers[name] - theirs).max() < tolerances[name], name
    if spec.keypoints:
        np.testing.assert_allclose(
            answers["keypoints"][..., 2], expected["keypoints"][..., 2].numpy(), atol=1e-4
        )


@pytest.mark.parametrize(("masks", "keypoints"), [(True, False), (False, True), (False, False)])
def test_a_network_with_some_branches_exports(masks: bool, keypoints: bool) -> None:
    assert_same_answers(lively_paper_model(96, 160, masks=masks, keypoints=keypoints))


def test_the_whole_r50_network_exports_at_a_size_that_is_no_multiple_of_32() -> None:
    model = lively_paper_model(90, 150, backbone="resnet50", stride_in_1x1=True)
    assert_same_answers(model)
