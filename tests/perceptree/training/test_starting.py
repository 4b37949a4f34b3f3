"""Starting weights of a training, and frozen parts."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
import timm
import torch
from narrow_networks import narrow_spec, short_plan
from torch import Tensor

from basetree.errors import SettingsError
from perceptree.errors import CheckpointError
from perceptree.models import (
    ModelSpec,
    SampleSettings,
    TreeRCNN,
    load_checkpoint,
    save_checkpoint,
)
from perceptree.training import Status, TrainSettings, train
from perceptree.training.starting import start_from

STILL = 1e-12
_STATISTICS = ("running_mean", "running_var", "num_batches_tracked")


def small_spec(height: int = 64, width: int = 128, **changes: Any) -> ModelSpec:
    return narrow_spec("depth", height, width, **changes)


def settings(**changes: Any) -> TrainSettings:
    return short_plan(**{"steps": 1, "warmup_steps": 1} | changes)


def write_start(path: Path, spec: ModelSpec) -> dict[str, Tensor]:
    torch.manual_seed(77)
    model = TreeRCNN(spec)
    save_checkpoint(path, model, {})
    return dict(model.state_dict())


def farthest(path: Path, start: dict[str, Tensor], but: str = "none") -> float:
    """The largest difference of a checkpoint's trained weights from ``start``."""
    made = load_checkpoint(path)[0].state_dict()
    return max(
        float((value - made[name]).abs().max())
        for name, value in start.items()
        if not name.endswith(_STATISTICS) and not name.startswith(but)
    )


def test_a_training_starts_from_a_checkpoint_of_another_input_size(
    posts: Path, tmp_path: Path
) -> None:
    file = tmp_path / "start.safetensors"
    start = write_start(file, small_spec(96, 160))
    plan = settings(learning_rate=STILL)
    report = train(small_spec(), plan, posts, tmp_path / "run", init=file)
    assert farthest(report.checkpoint, start) < 1e-6
    record = load_checkpoint(report.checkpoint)[1]["training"]
    assert record["init"]["name"] == "start.safetensors"
    assert len(record["init"]["sha256"]) == 64
    fresh = train(small_spec(), plan, posts, tmp_path / "fresh")
    assert farthest(fresh.checkpoint, start) > 0.1
    assert load_checkpoint(fresh.checkpoint)[1]["training"]["init"] == {"name": "random"}


def test_a_branch_that_only_one_has_is_left_out_or_stays_random(tmp_path: Path) -> None:
    file = tmp_path / "start.safetensors"
    start = write_start(file, small_spec(keypoints=False))
    model = TreeRCNN(small_spec(masks=False))
    before = {name: value.clone() for name, value in model.state_dict().items()}
    start_from(model, file)
    for name, value in model.state_dict().items():
        of = before if name.startswith("keypoint_head.") else start
        assert torch.equal(value, of[name]), name


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"box_head_width": 8}, r"hidden.0.weight has shape \(16, .*expected \(8, .*more$"),
        ({"backbone": "resnet18"}, "backbone is mobilenetv4_conv_small, expected resnet18 as in"),
        ({"std": (1.0,)}, r"std is \(80.0,\), expected \(1.0,\) as in"),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused_in_one_line(
    tmp_path: Path, changes: dict[str, Any], expected: str
) -> None:
    file = tmp_path / "start.safetensors"
    write_start(file, small_spec())
    with pytest.raises(CheckpointError, match=r"start.safetensors: .*" + expected) as caught:
        start_from(TreeRCNN(small_spec(**changes)), file)
    assert "\n" not in str(caught.value)


def test_a_missing_start_is_refused(posts: Path, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"none\.safetensors: no such file"):
        train(small_spec(), settings(), posts, tmp_path / "run", init=tmp_path / "none.safetensors")


def stop_at_once(status: Status) -> None:
    raise KeyboardInterrupt


def test_only_the_same_starting_weights_go_on(posts: Path, tmp_path: Path) -> None:
    file, renamed, other = (tmp_path / f"{name}.safetensors" for name in ("a", "b", "c"))
    write_start(file, small_spec())
    write_start(other, small_spec(96, 160))
    plan = settings(steps=2)
    with pytest.raises(KeyboardInterrupt):
        train(small_spec(), plan, posts, tmp_path / "run", stop_at_once, file)
    for init in (other, None):
        with pytest.raises(CheckpointError, match="training with other starting weights"):
            train(small_spec(), plan, posts, tmp_path / "run", init=init)
    file.rename(renamed)
    assert train(small_spec(), plan, posts, tmp_path / "run", init=renamed).steps == 2


def test_published_weights_are_used_and_not_fetched_again_to_go_on(
    posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, given = timm.create_model, []

    def create(name: str, pretrained: bool, **options: Any) -> Any:
        network = make(name, pretrained=False, **options)
        if pretrained:
            given.append(network)
        return network

    monkeypatch.setattr(timm, "create_model", create)
    plan = settings(steps=2, learning_rate=STILL)
    with pytest.raises(KeyboardInterrupt):
        train(small_spec(), plan, posts, tmp_path / "run", stop_at_once, "imagenet")
    report = train(small_spec(), plan, posts, tmp_path / "run", init="imagenet")
    assert len(given) == 1
    start = {f"backbone.trunk.{name}": value for name, value in given[0].state_dict().items()}
    assert farthest(report.checkpoint, start, but="backbone.trunk.conv_stem") < 1e-6


def test_what_is_frozen_stays_and_all_else_is_trained(posts: Path, tmp_path: Path) -> None:
    file = tmp_path / "start.safetensors"
    start = write_start(file, small_spec())
    plan = settings(
        steps=2,
        freeze_level=2,
        frozen_norms=True,
        learning_rate=1e-2,
        warmup_steps=1,
        sampling=SampleSettings(anchors=2000),
    )
    report = train(small_spec(), plan, posts, tmp_path / "run", init=file)
    made = load_checkpoint(report.checkpoint)[0].state_dict()
    same = {name for name, value in start.items() if torch.equal(value, made[name])}
    trunk = "backbone.trunk."
    frozen = {
        name
        for name in start
        if name.startswith((f"{trunk}conv_stem.", f"{trunk}bn1.", f"{trunk}blocks.0."))
        or (name.startswith(trunk) and ".bn" in name)
    }
    assert same == frozen


def test_frozen_norms_of_random_weights_are_refused(posts: Path, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="frozen_norms is set without starting weights"):
        train(small_spec(), settings(frozen_norms=True), posts, tmp_path / "run")


def test_the_sampling_reaches_the_losses_and_the_record(
    posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    losses = TreeRCNN.losses

    def watched(self: TreeRCNN, images: Any, targets: Any, sampling: Any, *more: Any) -> Any:
        seen.append(sampling)
        return losses(self, images, targets, sampling, *more)

    monkeypatch.setattr(TreeRCNN, "losses", watched)
    plan = settings(sampling=SampleSettings(regions=16, anchor_positive_iou=0.6))
    report = train(small_spec(), plan, posts, tmp_path / "run")
    assert seen == [plan.sampling]
    record = json.loads(json.dumps(load_checkpoint(report.checkpoint)[1]["training"]["settings"]))
    assert SampleSettings(**record["sampling"]) == plan.sampling
    changed = dataclasses.replace(plan, sampling=SampleSettings())
    with pytest.raises(CheckpointError, match="other settings"):
        train(small_spec(), changed, posts, tmp_path / "run")
