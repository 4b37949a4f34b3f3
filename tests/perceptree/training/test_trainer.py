"""Training: losses decrease, resuming is exact, and mismatches are refused."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from narrow_networks import narrow_spec as small_spec
from narrow_networks import short_plan

from basetree.errors import SettingsError
from perceptree.data import AugmentSettings, FrameStore, read_split
from perceptree.errors import CheckpointError, DatasetError
from perceptree.evaluation import evaluate, predict_with
from perceptree.models import load_checkpoint, make_spec
from perceptree.training import Status, TrainSettings, train

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]


def settings(**changes: Any) -> TrainSettings:
    return short_plan(**{"evaluate_every_steps": 2} | changes)


def weights(path: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(path)[0].state_dict()


def interrupt_at(step: int) -> Callable[[Status], None]:
    def progress(status: Status) -> None:
        if status.step == step:
            raise KeyboardInterrupt

    return progress


def test_resumed_equals_uninterrupted(posts: Path, tmp_path: Path) -> None:
    plan = settings(steps=5)
    whole = train(small_spec(), plan, posts, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(small_spec(), plan, posts, tmp_path / "parts", interrupt_at(2))
    assert not (tmp_path / "parts/best.safetensors").exists()
    with pytest.raises(KeyboardInterrupt):
        train(small_spec(), plan, posts, tmp_path / "parts", interrupt_at(3))
    parts = train(small_spec(), plan, posts, tmp_path / "parts")
    assert parts.steps == whole.steps == 5
    assert parts.metrics == whole.metrics
    first, second = weights(whole.checkpoint), weights(parts.checkpoint)
    assert [name for name in first if not torch.equal(first[name], second[name])] == []


def test_two_trainings_do_not_write_into_one_folder(posts: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"

    def second(status: Status) -> None:
        if status.step == 1:
            before = sorted(run.iterdir())
            with pytest.raises(CheckpointError, match="run: another training writes there"):
                train(small_spec(), settings(), posts, run)
            assert sorted(run.iterdir()) == before

    assert train(small_spec(), settings(), posts, run, second).steps == 4
    assert train(small_spec(), settings(), posts, run).steps == 4


def test_a_finished_training_is_not_repeated(posts: Path, tmp_path: Path) -> None:
    first = train(small_spec("rgb"), settings(), posts, tmp_path / "run")
    steps: list[int] = []
    again = train(
        small_spec("rgb"), settings(), posts, tmp_path / "run", lambda s: steps.append(s.step)
    )
    assert steps == []
    assert again == first


def test_the_checkpoint_says_how_it_was_made(posts: Path, tmp_path: Path) -> None:
    seen: list[Status] = []
    report = train(small_spec(), settings(), posts, tmp_path / "run", seen.append)
    model, record = load_checkpoint(report.checkpoint)
    assert model.spec == small_spec()
    training = record["training"]
    assert training["settings"]["steps"] == 4
    assert (training["data"], training["frames"]) == ("posts", 6)
    assert training["init"] == {"name": "random"}
    assert training["device"] == f"{os.cpu_count()} CPU cores"
    assert training["val"] == report.metrics.to_dict()
    assert [status.step for status in seen] == [1, 2, 3, 4]
    assert seen[-1].done == 1.0
    assert {"objectness", "score", "mask", "keypoint"} <= set(seen[-1].losses)
    lines = [json.loads(line) for line in (tmp_path / "run/log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines if "val" in line] == [2, 4]
    store = FrameStore(read_split(posts, "val"), model.spec)
    assert evaluate(predict_with(model), store, batch=4) == report.metrics


def test_a_budget_of_time_ends_the_training_and_counts_on(posts: Path, tmp_path: Path) -> None:
    plan = settings(minutes=1.0 / 60)
    seen: list[Status] = []

    def stop(status: Status) -> None:
        seen.append(status)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(small_spec(), plan, posts, tmp_path / "run", stop)
    # A slow first step may have used the whole time limit.
    report = train(small_spec(), plan, posts, tmp_path / "run", seen.append)
    assert report.elapsed_s == seen[-1].elapsed_s >= 1.0
    elapsed_s = [status.elapsed_s for status in seen]
    assert elapsed_s == sorted(elapsed_s)
    assert [status.step for status in seen] == list(range(1, report.steps + 1))


def test_the_losses_fall(posts: Path, tmp_path: Path) -> None:
    plan = settings(steps=25, learning_rate=3e-3)
    history: list[float] = []
    train(
        small_spec(),
        plan,
        posts,
        tmp_path / "run",
        lambda status: history.append(sum(status.losses.values())),
    )
    # The first reported losses are means from the start: the last five of 25 steps by difference.
    last = (25 * history[24] - 20 * history[19]) / 5
    assert last < 0.8 * history[0]


@pytest.mark.slow
def test_posts_are_learned(write_dataset: Callable[..., Path], tmp_path: Path) -> None:
    plan = TrainSettings(
        steps=150,
        batch=4,
        warmup_steps=10,
        learning_rate=3e-3,
        ema_decay=0.95,
        augment=AugmentSettings(scale=(0.9, 1.1), holes=0),
    )
    data = write_dataset(train=12, val=6)
    report = train(make_spec("edge-n", "depth", 64, 128), plan, data, tmp_path / "run")
    assert report.metrics.box_ap50 > 60


def test_other_settings_data_or_files_are_refused(
    posts: Path, tmp_path: Path, edit_split: Edit
) -> None:
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(small_spec(), settings(), posts, out, interrupt_at(1))
    with pytest.raises(CheckpointError, match=r"other settings: batch was 2, is 3; expected"):
        train(small_spec(), settings(batch=3), posts, out)
    with pytest.raises(CheckpointError, match="other model settings"):
        train(small_spec("rgb"), settings(), posts, out)
    edit_split(
        posts, "train", lambda content: content["images"].append(content["images"][0] | {"id": 99})
    )
    with pytest.raises(CheckpointError, match=r"other data: frames hash was .*; train was 6, is 7"):
        train(small_spec(), settings(), posts, out)
    for content in (b"", b"nothing like it", b"PK\x03\x04"):
        (out / "state.pt").write_bytes(content)
        with pytest.raises(CheckpointError, match=r"state\.pt: not a") as caught:
            train(small_spec(), settings(), posts, out)
        assert "\n" not in str(caught.value)
    torch.save({"weights": torch.zeros(2)}, out / "state.pt")
    with pytest.raises(CheckpointError, match="not a readable training state"):
        train(small_spec(), settings(), posts, out)


def test_a_folder_that_cannot_be_made_is_refused(posts: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CheckpointError, match=r"file/run: cannot be written"):
        train(small_spec(), settings(), posts, tmp_path / "file/run")


def test_a_split_without_trees_is_refused_at_the_start(
    posts: Path, tmp_path: Path, edit_split: Edit
) -> None:
    edit_split(posts, "val", lambda content: content["annotations"].clear())
    with pytest.raises(DatasetError, match="the val split has no labelled tree"):
        train(small_spec(), settings(), posts, tmp_path / "run")


def test_a_loss_that_is_not_finite_ends_the_training(posts: Path, tmp_path: Path) -> None:
    plan = settings(steps=300, learning_rate=1e12, clip_norm=1e30, warmup_steps=1)
    with pytest.raises(
        SettingsError,
        match=r"the loss is (nan|inf) at step \d+, on the frames 00\d+\.png, 00\d+\.png: .*rate",
    ):
        train(small_spec(), plan, posts, tmp_path / "run")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"steps": None}, "expected exactly one of them"),
        ({"steps": 3, "minutes": 1.0}, "expected exactly one of them"),
        ({"steps": 0}, "steps is 0: expected more than 0"),
        ({"steps": 3, "learning_rate": np.nan}, "learning_rate is nan"),
        ({"steps": 3, "warmup_steps": 0}, "warmup_steps is 0"),
        ({"steps": 3, "evaluate_every_steps": 0}, "evaluate_every_steps is 0"),
        ({"steps": 3, "accumulate": 3}, "accumulate is 3: expected a divisor of the batch, 8"),
        ({"steps": 3, "schedule": "up"}, "schedule is 'up': expected one of constant, steps"),
        ({"steps": 3, "rate_steps": (5, 5)}, "expected ascending step numbers"),
        ({"steps": 3, "ema_decay": 1.0}, "ema_decay is 1.0"),
        ({"steps": 3, "weight_decay": -1.0}, "weight_decay is -1.0"),
        ({"steps": 3, "seed": -1}, "seed is -1"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(SettingsError, match=expected):
        TrainSettings(**changes)
