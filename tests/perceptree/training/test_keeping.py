"""Trainings that hold a backbone near its starting weights."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from basetree.errors import SettingsError
from perceptree.errors import CheckpointError
from perceptree.models import TreeRCNN, load_checkpoint, make_spec, save_checkpoint
from perceptree.training import Engine, TrainSettings, train
from perceptree.training.keeping import StartingBackbone
from perceptree.training.recipes import recipe_settings
from perceptree.training.starting import load_heads

Make = Callable[..., Any]
_STATISTICS = ("running_mean", "running_var", "num_batches_tracked")


@pytest.fixture
def start(tmp_path: Path, narrow: Make) -> Path:
    """A checkpoint with random weights."""
    torch.manual_seed(7)
    path = tmp_path / "start.safetensors"
    save_checkpoint(path, TreeRCNN(narrow()), {})
    return path


def moved(start: Path, made: Path) -> tuple[float, float]:
    """The farthest that a weight of the backbone, and of the rest, has moved."""
    before, after = (load_checkpoint(path)[0].state_dict() for path in (start, made))
    far = {
        name: float((after[name] - value).abs().max())
        for name, value in before.items()
        if not name.endswith(_STATISTICS)
    }
    inside = [value for name, value in far.items() if name.startswith("backbone.")]
    return max(inside), max(v for name, v in far.items() if not name.startswith("backbone."))


def test_the_backbone_has_a_rate_of_its_own(
    posts: Path, start: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    found = {}
    for share in (0.0, 0.1, 1.0):
        settings = plan(backbone_rate_share=share, weight_decay=0.0, ema_decay=0.0)
        report = train(narrow(), settings, posts, tmp_path / str(share), init=start)
        found[share] = moved(start, report.checkpoint)
    assert found[0.0][0] == 0
    assert 0 < found[0.1][0] < 0.3 * found[1.0][0]
    assert min(rest for _, rest in found.values()) > 0.5 * found[1.0][1] > 0


def test_the_backbone_is_frozen_for_the_first_steps_also_when_resumed(
    posts: Path,
    start: Path,
    tmp_path: Path,
    narrow: Make,
    plan: Make,
    weights: Make,
    interrupt_at: Make,
) -> None:
    all_frozen = train(narrow(), plan(frozen_steps=4), posts, tmp_path / "frozen", init=start)
    assert moved(start, all_frozen.checkpoint)[0] == 0
    settings = plan(frozen_steps=2)
    whole = train(narrow(), settings, posts, tmp_path / "whole", init=start)
    assert moved(start, whole.checkpoint)[0] > 0
    for step in (1, 2, 3):
        out = tmp_path / f"parts{step}"
        with pytest.raises(KeyboardInterrupt):
            train(narrow(), settings, posts, out, interrupt_at(step), init=start)
        parts = train(narrow(), settings, posts, out, init=start)
        same, again = weights(whole.checkpoint), weights(parts.checkpoint)
        assert [name for name in same if not torch.equal(same[name], again[name])] == []


def test_a_pull_to_the_start_takes_its_share_of_the_distance(
    start: Path, narrow: Make, plan: Make
) -> None:
    model, _ = load_checkpoint(start)
    keeper = StartingBackbone(model, plan(keep_weights=50.0))
    before = {name: value.clone() for name, value in model.backbone.named_parameters()}
    with torch.no_grad():
        for parameter in model.backbone.parameters():
            parameter += 1.0
    keeper.pull(0.002)
    for name, value in model.backbone.named_parameters():
        assert torch.allclose(value, before[name] + 0.9, atol=1e-5)
    keeper.pull(1.0)  # never beyond the start
    assert all(torch.equal(v, before[n]) for n, v in model.backbone.named_parameters())


def test_the_loss_of_features_is_their_squared_difference_over_the_variance(
    start: Path, narrow: Make, plan: Make
) -> None:
    model, _ = load_checkpoint(start)
    other, _ = load_checkpoint(start)
    keeper = StartingBackbone(model, plan(keep_features=2.0))
    with torch.no_grad():
        for parameter in model.backbone.parameters():
            parameter *= 1.05
    generator = torch.Generator().manual_seed(2)
    images = torch.randint(0, 256, (2, 64, 128), dtype=torch.uint8, generator=generator)
    model.eval().features(images)
    parts: list[Tensor] = []
    for own, first in zip(
        model.backbone(model.normalise(images)),
        other.eval().backbone(other.normalise(images)),
        strict=True,
    ):
        for one, start_map in zip(own, first, strict=True):
            mean = start_map.sum() / start_map.numel()
            variance = ((start_map - mean) ** 2).sum() / (start_map.numel() - 1)
            parts.append(((one - start_map) ** 2).sum() / start_map.numel() / variance)
    model.features(images)
    shared = keeper.loss(lambda count: 1.5 * count)["features"]  # others have more images
    assert float(shared) == pytest.approx(2.0 * float(sum(parts)) / len(parts) / 1.5, rel=1e-4)
    model.features(images)
    loss = keeper.loss()["features"]
    assert float(loss) == pytest.approx(2.0 * float(sum(parts)) / len(parts), rel=1e-4)
    assert float(loss) > 0.01
    loss.backward()  # type: ignore[no-untyped-call]
    assert any(p.grad is not None and p.grad.abs().sum() > 0 for p in model.backbone.parameters())


def test_features_stay_nearer_and_resumed_or_with_workers_the_weights_are_the_same(
    posts: Path,
    start: Path,
    tmp_path: Path,
    narrow: Make,
    plan: Make,
    weights: Make,
    interrupt_at: Make,
) -> None:
    settings = plan(keep_features=3.0, keep_weights=10.0, frozen_norms=True)
    whole = train(narrow(), settings, posts, tmp_path / "whole", init=start)
    out = tmp_path / "parts"
    with pytest.raises(KeyboardInterrupt):
        train(narrow(), settings, posts, out, interrupt_at(2), init=start)
    parts = train(narrow(), settings, posts, out, init=start)
    helped = train(
        narrow(), settings, posts, tmp_path / "helped", init=start, engine=Engine(workers=2)
    )
    same = weights(whole.checkpoint)
    for other in (parts, helped):
        again = weights(other.checkpoint)
        assert [name for name in same if not torch.equal(same[name], again[name])] == []
    free = train(narrow(), plan(frozen_norms=True), posts, tmp_path / "free", init=start)
    assert moved(start, whole.checkpoint)[0] < moved(start, free.checkpoint)[0]


@pytest.mark.parametrize(
    "changes", [{"frozen_steps": 1}, {"keep_weights": 1.0}, {"keep_features": 1.0}]
)
def test_what_keeps_a_start_needs_one(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, changes: dict[str, float]
) -> None:
    (name,) = changes
    with pytest.raises(SettingsError, match=f"{name} is set without starting weights: expected"):
        train(narrow(), plan(**changes), posts, tmp_path / "run")


@pytest.mark.parametrize("name", ["frozen_steps", "keep_weights", "keep_features"])
def test_strengths_are_at_least_0(name: str) -> None:
    with pytest.raises(SettingsError, match=f"{name} is -1: expected at least 0"):
        TrainSettings(steps=1, **{name: -1})  # type: ignore[arg-type]


def test_the_recipe_transfer_keeps_norms_and_features(plan: Make) -> None:
    settings = recipe_settings("transfer", steps=3)
    assert settings.frozen_norms
    assert settings.keep_features > 0
    assert settings.depends_on_end


def test_heads_come_from_a_checkpoint_of_another_backbone(start: Path, narrow: Make) -> None:
    torch.manual_seed(1)
    model = TreeRCNN(narrow(backbone="efficientnet_lite0"))
    before = {name: value.clone() for name, value in model.state_dict().items()}
    load_heads(model, start)
    given = load_checkpoint(start)[0].state_dict()
    for name, value in model.state_dict().items():
        if name.startswith("backbone."):
            assert torch.equal(value, before[name])
        elif value.shape == given[name].shape:
            assert torch.equal(value, given[name])
        else:
            assert name.startswith("pyramid.lateral.")
            assert torch.equal(value, before[name])


def test_heads_of_another_width_are_refused_in_one_line(start: Path) -> None:
    model = TreeRCNN(make_spec("edge-n", "depth", 64, 128))
    with pytest.raises(CheckpointError, match=r"start\.safetensors: .* is missing"):
        load_heads(model, start)


def test_heads_are_recorded_and_belong_to_what_a_resumed_run_must_share(
    posts: Path, start: Path, tmp_path: Path, narrow: Make, plan: Make, interrupt_at: Make
) -> None:
    other = tmp_path / "other.safetensors"
    torch.manual_seed(8)
    save_checkpoint(other, TreeRCNN(narrow()), {})
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(narrow(), plan(), posts, out, interrupt_at(1), init=start, heads=start)
    with pytest.raises(CheckpointError, match="heads was"):
        train(narrow(), plan(), posts, out, init=start, heads=other)
    report = train(narrow(), plan(), posts, out, init=start, heads=start)
    record = load_checkpoint(report.checkpoint)[1]["training"]["init"]
    assert record["heads"]["name"] == "start.safetensors"
    assert record["heads"]["sha256"] == record["sha256"]


def test_the_spec_of_light_networks_pools_one_sample_per_bin() -> None:
    assert {make_spec(name, "rgb").roi_samples for name in ("edge-n", "edge-s")} == {1}
    assert make_spec("r50", "rgb").roi_samples == 0
    assert dataclasses.replace(make_spec("edge-n", "depth"), roi_samples=2).roi_samples == 2
