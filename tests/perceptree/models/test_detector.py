import copy
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from once import Once
from torch import Tensor
from torchvision.ops import box_iou

from perceptree.models import (
    ModelSpec,
    TreeRCNN,
    TreeTargets,
    load_checkpoint,
    make_spec,
    save_checkpoint,
)
from perceptree.models.scores import joint_scores, mask_certainty

HEIGHT, WIDTH = 96, 160


def small_spec(modality: str = "depth", **changes: object) -> ModelSpec:
    spec = make_spec("edge-n", modality, HEIGHT, WIDTH)  # type: ignore[arg-type]
    return dataclasses.replace(spec, **{"fpn_width": 32, **changes})  # type: ignore[arg-type]


def frames(spec: ModelSpec, count: int) -> tuple[Tensor, list[TreeTargets]]:
    """Vertical bars in front of a gradient; the last frame has no bars."""
    random = np.random.default_rng(0)
    images, targets = [], []
    for number in range(count):
        image = np.tile(np.linspace(250, 120, HEIGHT)[:, None], (1, WIDTH))
        trees = 0 if number == count - 1 else 2
        boxes = np.zeros((trees, 4), np.float32)
        masks = np.zeros((trees, HEIGHT, WIDTH), bool)
        for row in range(trees):
            x0, y0 = 20 + 70 * row + random.integers(0, 30), random.integers(4, 20)
            x1, y1 = x0 + random.integers(8, 14), y0 + random.integers(50, 70)
            image[y0:y1, x0:x1] = random.uniform(20, 90)
            boxes[row] = x0, y0, x1, y1
            masks[row, y0:y1, x0:x1] = True
        noisy = np.clip(image + random.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        images.append(noisy if spec.modality == "depth" else np.repeat(noisy[..., None], 3, 2))
        targets.append(
            TreeTargets(torch.from_numpy(boxes), bar_keypoints(boxes), torch.from_numpy(masks))
        )
    return torch.from_numpy(np.stack(images)), targets


def bar_keypoints(boxes: np.ndarray) -> Tensor:
    x0, y0, x1, y1 = boxes.T
    middle, high = (x0 + x1) / 2, y1 - y0
    x = np.stack((middle, x0, x1, middle, middle), axis=1)
    y = np.stack((y1 - 3, y1 - 9, y1 - 9, y1 - 0.3 * high, y1 - 0.6 * high), axis=1)
    return torch.from_numpy(np.stack((x, y, np.full_like(x, 2)), axis=2).astype(np.float32))


def train(model: TreeRCNN, steps: int, count: int = 4) -> list[dict[str, float]]:
    images, targets = frames(model.spec, count)
    optimizer = torch.optim.AdamW(model.parameters(), 3e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
    history = []
    model.train()
    for _ in range(steps):
        losses = model.losses(images, targets)
        optimizer.zero_grad()
        torch.stack(list(losses.values())).sum().backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimizer.step()
        schedule.step()
        history.append({name: value.item() for name, value in losses.items()})
    return history


@pytest.fixture(scope="module")
def trained(once: Once) -> TreeRCNN:
    def learn(folder: Path) -> None:
        torch.manual_seed(0)
        model = TreeRCNN(small_spec())
        train(model, 120)
        save_checkpoint(folder / "bars.safetensors", model, {})

    return load_checkpoint(once.folder("trained-on-bars", learn) / "bars.safetensors")[0].eval()


def test_a_few_frames_are_learned_from_random_weights(trained: TreeRCNN) -> None:
    images, targets = frames(trained.spec, 4)
    with torch.inference_mode():
        found = trained.detect(images)
    for number, target in enumerate(targets):
        confident = int((found.scores[number] > 0.85).sum())
        assert confident == len(target.boxes)
        if not confident:
            continue
        overlap, row = box_iou(target.boxes, found.boxes[number, :confident]).max(dim=1)
        assert overlap.min() > 0.5
        gap = (found.keypoints[number, row, :, :2] - target.keypoints[..., :2]).norm(dim=-1)
        assert gap.median() < 3.0
        assert (found.masks[number, row] > 0.5).float().mean() > 0.7


def test_rows_past_the_count_are_zero_and_scores_fall(trained: TreeRCNN) -> None:
    images, _ = frames(trained.spec, 4)
    with torch.inference_mode():
        found = trained.detect(images)
    assert found.boxes.shape == (4, 20, 4)
    assert found.num_detections.dtype == torch.int64
    for number, count in enumerate(found.num_detections.tolist()):
        assert (found.scores[number, :count] > trained.spec.score_threshold).all()
        assert (found.scores[number].diff() <= 0).all()
        for values in (found.boxes, found.scores, found.keypoints, found.masks):
            assert not values[number, count:].any()


def test_the_last_heads_see_the_kept_boxes_alone(trained: TreeRCNN) -> None:
    images, _ = frames(trained.spec, 4)
    assert trained.mask_head is not None
    assert trained.keypoint_head is not None
    seen: list[int] = []
    hooks = [
        head.register_forward_pre_hook(lambda _, given: seen.append(len(given[0])))
        for head in (trained.mask_head, trained.keypoint_head)
    ]
    with torch.inference_mode():
        found = trained.detect(images)
        every = trained.detect(images, every_row=True)
        nothing = with_spec(trained, score_threshold=0.9999).detect(images)
    for hook in hooks:
        hook.remove()
    kept = int(found.num_detections.sum())
    assert found.num_detections[0] > 0
    assert sorted(seen) == [1, 1, kept, kept, 80, 80]
    for some, all_rows in zip(found, every, strict=True):
        torch.testing.assert_close(some, all_rows, atol=1e-4, rtol=1e-4)
    assert not any(values.any() for values in nothing)


def with_spec(model: TreeRCNN, **changes: object) -> TreeRCNN:
    changed = copy.deepcopy(model)
    changed.spec = dataclasses.replace(model.spec, **changes)  # type: ignore[arg-type]
    return changed


def test_boxes_are_voted_for_whatever_the_threshold(trained: TreeRCNN) -> None:
    images, _ = frames(trained.spec, 4)
    unvoted = with_spec(trained, box_voting=False)
    with torch.inference_mode():
        found, plain = trained.detect(images), unvoted.detect(images)
        few = trained.detect(images, lowest_score=torch.tensor([0.6]))
    torch.testing.assert_close(found.scores, plain.scores)
    moved = (found.boxes - plain.boxes).abs().amax(dim=2)
    assert moved.max() > 0.05
    assert (box_iou(found.boxes[0], plain.boxes[0]).diag()[: found.num_detections[0]] > 0.5).all()
    for number, count in enumerate(few.num_detections.tolist()):
        torch.testing.assert_close(few.boxes[number, :count], found.boxes[number, :count])


def test_masks_count_in_the_scores_and_the_best_come_first(trained: TreeRCNN) -> None:
    images, _ = frames(trained.spec, 4)
    weighed = with_spec(trained, mask_score_weight=0.6)
    with torch.inference_mode():
        plain, found = trained.detect(images), weighed.detect(images)
        few = weighed.detect(images, lowest_score=torch.tensor([0.7]))
    joint = joint_scores(plain.scores, mask_certainty(plain.masks), 0.6)
    for number, count in enumerate(found.num_detections.tolist()):
        expected = joint[number, : plain.num_detections[number]].sort(descending=True)
        best = expected.indices[:count]
        assert (found.scores[number].diff() <= 0).all()
        torch.testing.assert_close(found.scores[number, : len(best)], expected.values[: len(best)])
        torch.testing.assert_close(found.boxes[number, : len(best)], plain.boxes[number, best])
        torch.testing.assert_close(found.masks[number, : len(best)], plain.masks[number, best])
        assert few.num_detections[number] == (found.scores[number] >= 0.7).sum()
        assert not any(values[number, count:].any() for values in found[:-1])
    assert (few.num_detections[:3] > 0).all()


def test_a_batch_answers_as_its_images_alone(trained: TreeRCNN) -> None:
    images, _ = frames(trained.spec, 4)
    with torch.inference_mode():
        together = trained.detect(images)
        for number in range(4):
            alone = trained.detect(images[number : number + 1])
            for ours, theirs in zip(alone, together, strict=True):
                torch.testing.assert_close(ours[0], theirs[number], atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("masks", [True, False])
@pytest.mark.parametrize("keypoints", [True, False])
@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_every_combination_of_branches_trains(masks: bool, keypoints: bool, modality: str) -> None:
    torch.manual_seed(0)
    model = TreeRCNN(small_spec(modality, masks=masks, keypoints=keypoints))
    history = train(model, 12, count=3)
    names = {"objectness", "proposal_shift", "score", "box_shift"}
    assert set(history[0]) == names | ({"mask"} if masks else set()) | (
        {"keypoint"} if keypoints else set()
    )
    for name in names & {"objectness", "score"} | set(history[0]) & {"mask", "keypoint"}:
        assert history[-1][name] < history[0][name], name


def test_every_weight_gets_a_gradient() -> None:
    torch.manual_seed(0)
    model = TreeRCNN(small_spec(levels=(3, 4, 5), roi_levels=(3, 4, 5))).train()
    images, targets = frames(model.spec, 3)
    torch.stack(list(model.losses(images, targets).values())).sum().backward()
    without = [name for name, value in model.named_parameters() if value.grad is None]
    assert without == []


def test_a_batch_without_any_tree_has_finite_losses_and_gradients() -> None:
    model = TreeRCNN(small_spec()).train()
    images, targets = frames(model.spec, 1)
    losses = model.losses(images, targets)
    torch.stack(list(losses.values())).sum().backward()
    assert all(torch.isfinite(value) for value in losses.values())
    assert losses["mask"].item() == losses["keypoint"].item() == losses["box_shift"].item() == 0.0


def test_losses_stay_float32_under_autocast() -> None:
    model = TreeRCNN(small_spec()).train()
    images, targets = frames(model.spec, 3)
    with torch.autocast("cpu", torch.bfloat16):
        losses = model.losses(images, targets)
    assert {value.dtype for value in losses.values()} == {torch.float32}


def test_normalisation_keeps_bgr_order() -> None:
    model = TreeRCNN(small_spec("rgb", mean=(10.0, 20.0, 30.0), std=(1.0, 2.0, 4.0)))
    images = torch.zeros(1, HEIGHT, WIDTH, 3, dtype=torch.uint8)
    images[..., 0], images[..., 1], images[..., 2] = 11, 22, 34
    assert model.normalise(images)[0, :, 5, 7].tolist() == [1.0, 1.0, 1.0]


def test_depth_is_repeated_for_a_network_that_was_made_for_colours() -> None:
    model = TreeRCNN(small_spec("depth", mean=(10.0, 20.0, 30.0), std=(1.0, 2.0, 4.0)))
    images = torch.full((1, HEIGHT, WIDTH), 34, dtype=torch.uint8)
    assert model.normalise(images)[0, :, 5, 7].tolist() == [24.0, 7.0, 1.0]


def test_images_of_another_kind_are_refused() -> None:
    model = TreeRCNN(small_spec())
    with pytest.raises(ValueError, match=r"expected torch.uint8 of shape \(B, 96, 160\)"):
        model.detect(torch.zeros(1, 96, 128, dtype=torch.uint8))
    with pytest.raises(ValueError, match=r"images are torch.float32"):
        model.detect(torch.zeros(1, HEIGHT, WIDTH))
