"""Extending, branching and early stopping of a training."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from schema_check import check_schema

import perceptree.training.trainer
from basetree.errors import SettingsError
from perceptree.errors import CheckpointError
from perceptree.evaluation import Metrics
from perceptree.training import Engine, Status, train
from perceptree.training.branching import BranchedRun
from perceptree.training.run_log import LOG_NAME, RunLog, read_log

Make = Callable[..., Any]


def test_a_longer_run_equals_one_that_was_long_from_the_start(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    train(narrow(), plan(steps=5), posts, tmp_path / "whole")
    train(narrow(), plan(steps=3), posts, tmp_path / "parts")
    parts = train(narrow(), plan(steps=5), posts, tmp_path / "parts")
    assert parts.steps == 5
    one, two = (torch.load(tmp_path / run / "state.pt") for run in ("whole", "parts"))
    assert one["step"] == two["step"] == 5
    for name, value in one["model"].items():
        assert torch.equal(value, two["model"][name]), name


def test_a_schedule_that_looks_ahead_cannot_be_extended(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    train(narrow(), plan(steps=1, schedule="cosine"), posts, tmp_path / "run")
    with pytest.raises(CheckpointError, match=r"other settings: steps was 1, is 2; expected"):
        train(narrow(), plan(steps=2, schedule="cosine"), posts, tmp_path / "run")


def test_a_branch_counts_on_and_its_rate_falls_to_nothing(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    train(narrow(), plan(steps=3, learning_rate=1e-3), posts, tmp_path / "run")
    before = (tmp_path / "run/state.pt").read_bytes()
    seen: list[Status] = []
    decay = plan(steps=4, schedule="decay", learning_rate=1e-3, final_rate_share=0.0)
    report = train(
        narrow(), decay, posts, tmp_path / "branch", seen.append, branch=tmp_path / "run"
    )
    assert [status.step for status in seen] == [4, 5, 6, 7]
    assert [status.rate for status in seen] == pytest.approx([1e-3, 7.5e-4, 5e-4, 2.5e-4])
    assert report.steps == 4
    assert (tmp_path / "run/state.pt").read_bytes() == before
    again = train(narrow(), decay, posts, tmp_path / "branch", branch=tmp_path / "run")
    assert again == report


def test_a_run_with_other_val_labels_is_not_resumed(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, edit_split: Make
) -> None:
    def moved(content: dict[str, Any]) -> None:
        content["annotations"][0]["bbox"][0] += 3

    train(narrow(), plan(steps=1), posts, tmp_path / "run")
    edit_split(posts, "val", moved)
    with pytest.raises(CheckpointError, match="other data: val frames hash was"):
        train(narrow(), plan(steps=2), posts, tmp_path / "run")


def test_a_branch_trains_with_its_own_rates_and_precision(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    given = {"learning_rate": 1e-3, "weight_decay": 0.05, "backbone_rate_share": 0.5}
    bf16, fp32 = Engine(precision="bf16"), Engine(precision="fp32")
    train(narrow(), plan(steps=1, **given), posts, tmp_path / "run", engine=bf16)
    other = plan(steps=1, **given | {"weight_decay": 0.01, "backbone_rate_share": 0.1})
    train(narrow(), other, posts, tmp_path / "branch", engine=fp32, branch=tmp_path / "run")
    state = torch.load(tmp_path / "branch/state.pt")
    groups = state["optimizer"]["param_groups"]
    assert {group["rate_share"] for group in groups} == {1.0, 0.1}
    assert {group["weight_decay"] for group in groups} == {0.01, 0.0}
    assert state["precision"] == "fp32"
    with pytest.raises(SettingsError, match="precision is bf16 and the run to resume has fp32"):
        train(narrow(), other, posts, tmp_path / "branch", engine=bf16, branch=tmp_path / "run")


def test_a_branch_needs_a_run_of_the_same_network(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    with pytest.raises(CheckpointError, match=r"none: has no state\.pt, expected the folder of a"):
        train(narrow(), plan(), posts, tmp_path / "out", branch=tmp_path / "none")
    train(narrow(), plan(steps=1), posts, tmp_path / "run")
    with pytest.raises(CheckpointError, match="other model settings: masks was True, is False"):
        train(narrow(masks=False), plan(), posts, tmp_path / "out", branch=tmp_path / "run")


def test_the_state_of_an_older_version_goes_on_at_the_values_that_it_had(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    run, branch = tmp_path / "run", tmp_path / "branch"
    train(narrow(), plan(steps=1), posts, run)
    state = torch.load(run / "state.pt")
    identity = json.loads(state["identity"])
    for name in ("box_voting", "mask_score_weight", "reduction", "separable_proposals"):
        del identity["model settings"][name]
    torch.save(state | {"identity": json.dumps(identity)}, run / "state.pt")
    old = BranchedRun.read(run).spec
    weighed = dataclasses.replace(old, mask_score_weight=1.5)
    with pytest.raises(CheckpointError, match=r"mask_score_weight was 0\.0, is 1\.5"):
        train(weighed, plan(steps=1), posts, branch, branch=run)
    assert train(old, plan(steps=1), posts, branch, branch=run).steps == 1
    assert train(old, plan(steps=2), posts, run).steps == 2


def test_an_evaluation_that_was_interrupted_is_made_up_for(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = plan(steps=4, evaluate_every_steps=2)

    def stopped(*arguments: Any, **options: Any) -> Metrics:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(perceptree.training.trainer, "evaluate", stopped)
        with pytest.raises(KeyboardInterrupt):
            train(narrow(), settings, posts, tmp_path / "run")
    train(narrow(), settings, posts, tmp_path / "run")
    evaluated = [entry["step"] for entry in read_log(tmp_path / "run") if "val" in entry]
    assert evaluated == [2, 4]


def test_it_ends_early_when_the_precision_no_longer_rises(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = iter([10.0, 30.0, 20.0, 30.0, 50.0])

    def told(*arguments: Any, **named: Any) -> Metrics:
        ap = next(values)
        return Metrics(1, 1, ap, ap, None, None, None, None, {})

    monkeypatch.setattr(perceptree.training.trainer, "evaluate", told)
    settings = plan(steps=50, evaluate_every_steps=1, patience=2)
    report = train(narrow(), settings, posts, tmp_path / "run")
    # Neither 20 nor another 30 is better than the first 30.
    assert report.steps == 4
    assert report.metrics.box_ap == 30.0


def test_both_logs_are_written(posts: Path, tmp_path: Path, narrow: Make, plan: Make) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    settings = plan(steps=4, evaluate_every_steps=2)
    report = train(narrow(), settings, posts, tmp_path / "run")
    entries = read_log(tmp_path / "run")
    for entry in entries:
        check_schema(entry, "perceptree.training-log")
    assert [entry["step"] for entry in entries if "val" in entry] == [2, 4]
    events = EventAccumulator(str(tmp_path / "run/tensorboard"))
    events.Reload()
    told = [(event.step, event.value) for event in events.Scalars("val/box_ap")]
    assert told == [(e["step"], pytest.approx(e["val"]["box_ap"])) for e in entries if "val" in e]
    assert report.metrics.box_ap == max(value for _, value in told)


def test_half_a_line_at_the_end_of_a_log_is_passed_over(tmp_path: Path) -> None:
    line = json.dumps({"step": 50, "elapsed_s": 3.0, "losses": {"mask": 1.0}})
    (tmp_path / "log.jsonl").write_text(f"{line}\n{line[:20]}")
    assert [entry["step"] for entry in read_log(tmp_path)] == [50]
    (tmp_path / "log.jsonl").write_text(f"{line[:20]}\n{line}\n")
    with pytest.raises(CheckpointError, match="line 1 is no log entry of a training"):
        read_log(tmp_path)


def test_the_state_is_saved_by_the_clock(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    class Killed(Exception):
        pass

    def kill(status: Status) -> None:
        if status.step == 3:
            raise Killed

    for save_s, saved in ((1e-9, True), (1e9, False)):
        out = tmp_path / f"{saved}"
        with pytest.raises(Killed):
            train(narrow(), plan(), posts, out, kill, engine=Engine(save_s=save_s))
        assert (out / "state.pt").exists() == saved
        if saved:
            assert torch.load(out / "state.pt")["step"] == 2


def test_a_line_that_was_cut_off_does_not_hide_the_next(tmp_path: Path) -> None:
    (tmp_path / LOG_NAME).write_text('{"step": 50}\n{"step": 1')
    log = RunLog(tmp_path, first_step=50)
    log.write({"step": 60, "loss": 1.0})
    log.close()
    assert [entry["step"] for entry in read_log(tmp_path)] == [50, 60]
