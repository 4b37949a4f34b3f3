"""Training changes all parts of a network except the frozen ones."""

import pytest
import torch
from torch import Tensor, nn

from perceptree.models import ModelSpec, SampleSettings, TreeRCNN, TreeTargets, make_spec

HEIGHT, WIDTH = 64, 128
# Enough anchors that every level has some.
SAMPLING = SampleSettings(
    proposals_per_level=20, proposals=20, anchors=5000, regions=8, region_positive_share=0.5
)
NARROW = {
    "fpn_width": 16,
    "box_head_width": 16,
    "mask_head_widths": (8,),
    "keypoint_head_widths": (8,),
}


def light_spec() -> ModelSpec:
    return make_spec("edge-n", "rgb", HEIGHT, WIDTH, backbone="mobilenetv4_conv_small", **NARROW)


def paper_spec() -> ModelSpec:
    return make_spec("r50", "rgb", HEIGHT, WIDTH, **NARROW)


def two_steps(model: TreeRCNN) -> set[str]:
    """Train, and return the names of the tensors that changed."""
    before = {name: value.clone() for name, value in model.state_dict().items()}
    boxes = torch.tensor([[30.0, 8.0, 50.0, 60.0], [80.0, 4.0, 96.0, 56.0]])
    points = torch.rand(2, 5, 2) * (boxes[:, None, 2:] - boxes[:, None, :2]) + boxes[:, None, :2]
    keypoints = torch.cat((points, torch.full((2, 5, 1), 2.0)), dim=2)
    masks = torch.zeros(2, HEIGHT, WIDTH, dtype=torch.bool)
    for mask, (x0, y0, x1, y1) in zip(masks, boxes.int().tolist(), strict=True):
        mask[y0:y1, x0:x1] = True
    images = torch.randint(0, 256, (2, HEIGHT, WIDTH, 3), dtype=torch.uint8)
    targets = [TreeTargets(boxes, keypoints, masks)] * 2
    trained = [p for p in model.parameters() if p.requires_grad]
    # The size of Adam's steps does not depend on that of the gradient.
    optimizer = torch.optim.Adam(trained, 1e-3, eps=1e-30)
    model.train()
    for _ in range(2):
        optimizer.zero_grad()
        losses: list[Tensor] = list(model.losses(images, targets, SAMPLING).values())
        torch.stack(losses).sum().backward()
        optimizer.step()
    after = model.state_dict()
    return {name for name, value in before.items() if not torch.equal(after[name], value)}


def norm_tensors(module: nn.Module) -> set[str]:
    return {
        f"{name}.{key}"
        for name, part in module.named_modules()
        if isinstance(part, nn.BatchNorm2d)
        for key in part.state_dict()
    }


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


def test_without_freezing_everything_is_trained() -> None:
    model = TreeRCNN(light_spec())
    assert two_steps(model) == set(model.state_dict())


def test_a_frozen_light_model_changes_only_beyond_stride_four() -> None:
    model = TreeRCNN(light_spec())
    model.freeze(2, norms=False)
    changed = two_steps(model)
    first = ("conv_stem.", "bn1.", "blocks.0.")
    frozen = {
        name
        for name in model.state_dict()
        if name.removeprefix("backbone.trunk.").startswith(first)
    }
    assert len(frozen) > 10
    assert changed == set(model.state_dict()) - frozen


def test_a_frozen_paper_model_changes_all_but_stem_layer1_and_norms() -> None:
    model = TreeRCNN(paper_spec())
    for part in model.backbone.modules():
        if isinstance(
            part, nn.BatchNorm2d
        ):  # as after training: the last norm of a block starts at 0
            part.weight.data.uniform_(0.5, 1.0)
    model.freeze(2, norms=True)
    changed = two_steps(model)
    trunk = "backbone.trunk."
    stem = {
        name
        for name in model.state_dict()
        if name.startswith((f"{trunk}conv1.", f"{trunk}bn1.", f"{trunk}layer1."))
    }
    norms = norm_tensors(model) - stem
    assert len(norms) == 5 * (4 + 6 + 3) * 3 + 5 * 3
    assert changed == set(model.state_dict()) - stem - norms


def test_frozen_norms_alone_leave_the_convolutions_free() -> None:
    model = TreeRCNN(light_spec())
    model.freeze(0, norms=True)
    changed = two_steps(model)
    fixed = {f"backbone.{name}" for name in norm_tensors(model.backbone)}
    assert len(fixed) > 100
    assert changed == set(model.state_dict()) - fixed


def test_levels_are_detectron2s_stages_of_a_resnet() -> None:
    model = TreeRCNN(paper_spec())
    for level, last in (
        (0, 0),
        (1, 2),
        (2, 3),
        (3, 4),
        (5, 6),
    ):  # ascending levels: no part is unfrozen
        model.freeze(level)
        parts = ("conv1.", "bn1.", "layer1.", "layer2.", "layer3.", "layer4.")[:last]
        start = tuple(f"backbone.trunk.{part}" for part in parts)
        for name, parameter in model.named_parameters():
            assert parameter.requires_grad == (not name.startswith(start)), (level, name)
