"""The paper's layout (levels 2 to 6, four pooled levels, Detectron2's keypoints), made narrow."""

import pytest
import torch
from narrow_networks import narrow_paper_spec as narrow_spec
from torchvision.ops import box_iou, masks_to_boxes

from perceptree.models import (
    ModelSpec,
    SampleSettings,
    TreeRCNN,
    TreeTargets,
    losses,
    make_spec,
)

SAMPLING = SampleSettings(proposals_per_level=60, proposals=60, anchors=64, regions=32)


def bars(spec: ModelSpec) -> tuple[torch.Tensor, list[TreeTargets]]:
    """Two images with different numbers of vertical bars, of sizes for all pooled levels."""
    random = torch.Generator().manual_seed(0)
    shape = (2, spec.height, spec.width, 3)
    images = torch.randint(60, 200, shape, generator=random, dtype=torch.uint8)
    targets = []
    for number, posts in enumerate([[(20, 60, 8), (70, 88, 20)], [(100, 80, 30)]]):
        masks = torch.zeros(len(posts), spec.height, spec.width, dtype=torch.bool)
        boxes, points = [], []
        for row, (x, bottom, width) in enumerate(posts):
            masks[row, 5:bottom, x : x + width] = True
            images[number, 5:bottom, x : x + width] = 20
            boxes.append([x, 5.0, x + width, bottom])
            middle = x + width / 2
            across = [middle, x, x + width, middle, middle]
            down = [bottom - 2, bottom - 6, bottom - 6, bottom - 20, bottom - 35]
            points.append([[a, d, 2.0] for a, d in zip(across, down, strict=True)])
        targets.append(
            TreeTargets(torch.tensor(boxes).float(), torch.tensor(points).float(), masks)
        )
    return images, targets


@pytest.mark.parametrize("masks", [True, False])
@pytest.mark.parametrize("keypoints", [True, False])
def test_every_combination_of_branches_trains(masks: bool, keypoints: bool) -> None:
    torch.manual_seed(0)
    model = TreeRCNN(narrow_spec(masks=masks, keypoints=keypoints)).train()
    images, targets = bars(model.spec)
    optimizer = torch.optim.SGD(model.parameters(), 1e-3)
    before = {name: value.detach().clone() for name, value in model.named_parameters()}
    found = model.losses(images, targets, SAMPLING)
    assert all(torch.isfinite(value) and value > 0 for value in found.values())
    torch.stack(list(found.values())).sum().backward()
    optimizer.step()
    heads = ("box_head", "mask_head", "keypoint_head", "proposer", "pyramid")
    for name, value in model.named_parameters():
        assert torch.isfinite(value).all()
        if name.startswith(heads):
            assert not torch.equal(value, before[name]), name
    names = {"objectness", "proposal_shift", "score", "box_shift"}
    names |= ({"mask"} if masks else set()) | ({"keypoint"} if keypoints else set())
    assert set(found) == names
    with torch.inference_mode():
        trees = model.eval().detect(images)
    assert trees.num_detections.any()
    assert bool(trees.masks.any()) == masks
    assert bool(trees.keypoints.any()) == keypoints


def test_regions_learn_the_mask_and_keypoints_of_their_own_images_tree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: dict[str, list[torch.Tensor]] = {}

    def masks_of(boxes: torch.Tensor, masks: torch.Tensor, tree: torch.Tensor) -> torch.Tensor:
        seen["masks"] = [boxes, masks_to_boxes(masks)[tree]]
        return original_masks(boxes, masks, tree)

    def keypoints_of(boxes: torch.Tensor, points: torch.Tensor) -> tuple[torch.Tensor, ...]:
        seen["keypoints"] = [boxes, points]
        return original_keypoints(boxes, points)

    original_masks, original_keypoints = losses.mask_targets, losses.keypoint_targets
    monkeypatch.setattr(losses, "mask_targets", masks_of)
    monkeypatch.setattr(losses, "keypoint_targets", keypoints_of)
    torch.manual_seed(0)
    model = TreeRCNN(narrow_spec())
    images, targets = bars(model.spec)
    model.losses(images, targets, SAMPLING)
    boxes, truth = seen["masks"]
    assert {int(x) for x in truth[:, 0]} == {20, 70, 100}
    assert float(box_iou(boxes, truth).diagonal().min()) > 0.4
    boxes, points = seen["keypoints"]
    middle = (boxes[:, 0] + boxes[:, 2]) / 2
    assert float((points[:, 0, 0] - middle).abs().max()) < 15.0


def test_a_step_of_the_r50_network_is_finite_and_reaches_every_weight() -> None:
    torch.manual_seed(0)
    model = TreeRCNN(narrow_spec(backbone="resnet50", stride_in_1x1=True)).train()
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.constant_(module.weight, 0.5)  # the last norm of a block starts at zero
    images, targets = bars(model.spec)
    found = model.losses(images, targets, SAMPLING)
    assert all(torch.isfinite(value) for value in found.values())
    torch.stack(list(found.values())).sum().backward()
    for name, value in model.named_parameters():
        assert value.grad is not None, name
        assert torch.isfinite(value.grad).all(), name
        assert value.grad.any(), name


@pytest.mark.parametrize("preset", ["r50", "edge-n"])
def test_inputs_that_are_no_multiple_of_32_are_padded_inside(preset: str) -> None:
    torch.manual_seed(0)
    if preset == "r50":
        spec = narrow_spec(90, 150)
    else:
        spec = make_spec("edge-n", "rgb", 90, 150, fpn_width=16)
    model = TreeRCNN(spec).train()
    images, targets = bars(spec)
    padded = model.normalise(images)
    assert padded.shape == (2, 3, 96, 160)
    assert not padded[:, :, 90:].any()
    assert not padded[:, :, :, 150:].any()
    maps, _ = model.features(images)
    assert {n: tuple(x.shape[2:]) for n, x in maps.items()} == {
        n: spec.map_size(n) for n in spec.levels
    }
    assert all(torch.isfinite(v) for v in model.losses(images, targets, SAMPLING).values())
    with torch.no_grad():
        # Larger boxes would exceed the image.
        model.box_head.shift.bias.copy_(torch.tensor([0.0, 0.0, 10.0, 10.0]))
        found = model.eval().detect(images)
    assert int(found.num_detections.min()) > 0
    assert float(found.boxes.min()) >= 0.0
    rounding = 1e-4  # of boxes that are averaged
    assert 140.0 < float(found.boxes[..., 2].max()) <= 150.0 + rounding
    assert 80.0 < float(found.boxes[..., 3].max()) <= 90.0 + rounding
    points = found.keypoints[found.scores > 0]
    assert float(points[..., 0].max()) <= 150.0 + rounding
    assert float(points[..., 1].max()) <= 90.0 + rounding


def test_padding_answers_as_a_larger_frame_with_mean_coloured_borders() -> None:
    torch.manual_seed(0)
    small, large = narrow_spec(90, 150), narrow_spec(96, 160)
    mean = (103.0, 116.0, 124.0)  # integers, as in a frame
    models = [TreeRCNN(make_changed(spec, mean)).eval() for spec in (small, large)]
    models[1].load_state_dict(models[0].state_dict())
    images, _ = bars(small)
    framed = torch.tensor(mean, dtype=torch.uint8).expand(2, 96, 160, 3).clone()
    framed[:, :90, :150] = images
    with torch.inference_mode():
        first, _ = models[0].features(images)
        second, _ = models[1].features(framed)
    for level, expected in second.items():
        torch.testing.assert_close(first[level], expected, msg=f"level {level}")


def make_changed(spec: ModelSpec, mean: tuple[float, ...]) -> ModelSpec:
    return ModelSpec.from_dict({**spec.to_dict(), "mean": mean})
