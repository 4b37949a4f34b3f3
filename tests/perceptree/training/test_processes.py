"""Several processes train like one, and end together."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import joint_run
import joint_wait
import pytest
import torch

import perceptree.training.run
from basetree.errors import SettingsError
from perceptree.models import TreeRCNN, save_checkpoint
from perceptree.training import train
from perceptree.training.batches import SlotSampler
from perceptree.training.processes import Processes
from perceptree.training.state import read_state

Make = Callable[..., Any]


def run_two(data: Path, out: Path, *options: Any) -> subprocess.CompletedProcess[str]:
    return torchrun([joint_run.__file__, data, out, *options])


def torchrun(words: list[Any]) -> subprocess.CompletedProcess[str]:
    """Run a program in two processes."""
    start = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    return subprocess.run(
        [sys.executable, *start, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def losses(out: Path) -> list[dict[str, float]]:
    return json.loads((out / "told.json").read_text())  # type: ignore[no-any-return]


@pytest.mark.parametrize("modality", ["depth", "both"])
def test_two_processes_have_the_losses_of_one(
    write_dataset: Callable[..., Path], tmp_path: Path, modality: str
) -> None:
    data = write_dataset(train=10)
    joint_run.run(data, tmp_path / "1", modality=modality)
    done = run_two(data, tmp_path / "2", "--modality", modality)
    assert done.returncode == 0, done.stderr
    one, two = losses(tmp_path / "1"), losses(tmp_path / "2")
    assert len(one) == len(two) == 8
    for alone, together in zip(one, two, strict=True):
        assert together == pytest.approx(alone, abs=1e-4)
    # The losses change, so the network is trained.
    assert sum(one[-1].values()) < sum(one[0].values())


def test_two_processes_hold_a_backbone_near_its_start_as_one_does(
    write_dataset: Callable[..., Path], tmp_path: Path, narrow: Make
) -> None:
    data, start = write_dataset(train=10), tmp_path / "start.safetensors"
    torch.manual_seed(4)
    save_checkpoint(start, TreeRCNN(narrow(proposal_nms_iou=1.0)), {})
    joint_run.run(data, tmp_path / "1", start=start)
    done = run_two(data, tmp_path / "2", "--near", start)
    assert done.returncode == 0, done.stderr
    one, two = losses(tmp_path / "1"), losses(tmp_path / "2")
    assert len(one) == len(two) == 8
    for alone, together in zip(one, two, strict=True):
        assert together == pytest.approx(alone, abs=1e-4)
    assert one[2]["features"] >= 0
    assert one[-1]["features"] > 0


@pytest.mark.slow
def test_machines_without_a_common_folder_go_on_from_the_same_state(
    write_dataset: Callable[..., Path], tmp_path: Path
) -> None:
    data = write_dataset(train=10)
    joint_run.run(data, tmp_path / "1")
    for steps in (joint_run.STEPS // 2, joint_run.STEPS):
        done = run_two(data, tmp_path / "2", "--apart", "--steps", steps)
        assert done.returncode == 0, done.stderr
    whole, resumed = (read_state(tmp_path / run, {}) for run in ("1/state.pt", "2/0/state.pt"))
    assert whole["step"] == resumed["step"] == joint_run.STEPS
    assert resumed["means"] == pytest.approx(whole["means"], abs=1e-4)
    assert not (tmp_path / "2/1/state.pt").exists()


@pytest.mark.slow
def test_processes_wait_for_what_one_does_alone() -> None:
    done = torchrun([joint_wait.__file__])
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_process_that_dies_ends_the_other(posts: Path, tmp_path: Path) -> None:
    started_s = time.monotonic()
    done = run_two(posts, tmp_path / "run", "--dies-at", 3)
    assert done.returncode != 0
    assert "this process dies" in done.stderr
    assert time.monotonic() - started_s < 60 + 30  # including the start of both


def test_a_batch_that_cannot_be_divided_is_refused(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def three(device: str) -> Iterator[Processes]:
        yield Processes(0, 3)

    monkeypatch.setattr(perceptree.training.run, "process_group", three)
    expected = "batch is 4: expected a multiple of 6 .processes times accumulate"
    with pytest.raises(SettingsError, match=expected):
        train(narrow(), plan(batch=4, accumulate=2), posts, tmp_path / "run")


def test_torchruns_word_without_torchrun_is_one_line(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.delenv("MASTER_ADDR", raising=False)
    with pytest.raises(
        SettingsError, match=r"WORLD_SIZE is 2, but .* expected a start by torchrun"
    ):
        train(narrow(), plan(), posts, tmp_path / "run")


def test_the_frames_of_a_step_are_dealt_out_whatever_the_processes(plan: Make) -> None:
    settings = plan(batch=12, accumulate=2)
    alone = iter(SlotSampler(settings, 3, 0, 1))
    parts = [iter(SlotSampler(settings, 3, rank, 3)) for rank in range(3)]
    for step in (3, 4):
        whole = [slot for _ in range(2) for slot in next(alone)]
        dealt = [slot for part in parts for _ in range(2) for slot in next(part)]
        assert sorted(dealt) == whole == [(step, row) for row in range(12)]
