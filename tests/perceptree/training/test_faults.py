"""Errors while training keep existing files, and are reported in one line."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import pytest
import torch
from file_limits import largest_file

import perceptree.training.state
from basetree.errors import SettingsError
from perceptree.errors import CheckpointError, DatasetError
from perceptree.models import save_checkpoint
from perceptree.training import Engine, Preparing, train
from perceptree.training.state import write_state

Make = Callable[..., Any]


def test_a_full_disk_keeps_the_last_state(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    train(narrow(), plan(steps=1), posts, tmp_path / "run")
    kept = (tmp_path / "run/state.pt").read_bytes()

    def full(state: Any, file: BinaryIO) -> None:
        file.write(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(perceptree.training.state.torch, "save", full)
    with pytest.raises(CheckpointError, match=r"state\.pt: cannot be written .*No space left"):
        train(narrow(), plan(steps=2), posts, tmp_path / "run")
    assert (tmp_path / "run/state.pt").read_bytes() == kept
    assert list((tmp_path / "run").glob(".*")) == []


def test_a_disk_that_fills_while_torch_writes_is_said(tmp_path: Path) -> None:
    with (
        pytest.raises(CheckpointError, match=r"state\.pt: cannot be written \(File too large\)$"),
        largest_file(5000),
    ):
        write_state(tmp_path / "state.pt", {"model": torch.zeros(30000)}, {})
    assert list(tmp_path.iterdir()) == []


def test_killed_at_any_step_it_ends_with_the_same_weights(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    """The process is killed, so it cannot clean up."""
    plain = tmp_path / "plain"
    train(narrow(), plan(), posts, plain, engine=Engine(precision="fp32"))
    killed = tmp_path / "killed"
    script = (
        "import sys\nfrom pathlib import Path\nfrom perceptree.models import make_spec\n"
        "from perceptree.training import Engine, TrainSettings, train\n"
        "spec = make_spec('edge-n', 'depth', 64, 128, fpn_width=16, box_head_width=16,"
        " mask_head_widths=(8,), keypoint_head_widths=(8,))\n"
        "plan = TrainSettings(steps=4, batch=2, warmup_steps=2, evaluate_every_steps=100)\n"
        "def told(status):\n"
        "    if status.step == 3:\n        print('three', flush=True)\n        input()\n"
        "train(spec, plan, Path(sys.argv[1]), Path(sys.argv[2]), told,"
        " engine=Engine(precision='fp32', save_s=1e-9))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(posts), str(killed)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "three\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert torch.load(killed / "state.pt")["step"] == 2
    train(narrow(), plan(), posts, killed, engine=Engine(precision="fp32"))
    one, two = (torch.load(run / "state.pt")["model"] for run in (plain, killed))
    assert [name for name in one if not torch.equal(one[name], two[name])] == []


def test_a_finished_training_ends_its_workers(posts: Path, tmp_path: Path) -> None:
    script = (
        "import sys\nfrom pathlib import Path\nfrom perceptree.models import make_spec\n"
        "from perceptree.training import Engine, TrainSettings, train\n"
        "spec = make_spec('edge-n', 'depth', 64, 128, fpn_width=16, box_head_width=16,"
        " masks=False, keypoints=False)\n"
        "plan = TrainSettings(steps=1, batch=2, warmup_steps=1, evaluate_every_steps=100)\n"
        "train(spec, plan, Path(sys.argv[1]), Path(sys.argv[2]),"
        " engine=Engine(precision='fp32', workers=1))\n"
    )
    command = [sys.executable, "-c", script, str(posts), str(tmp_path / "run")]
    subprocess.run(command, check=True, timeout=300)


@pytest.mark.slow
def test_the_workers_end_with_a_killed_trainer(posts: Path, tmp_path: Path) -> None:
    script = (
        "import sys\nfrom pathlib import Path\nfrom perceptree.models import make_spec\n"
        "from perceptree.training import Engine, TrainSettings, train\n"
        "import multiprocessing\n"
        "def told(status):\n"
        "    print(*[c.pid for c in multiprocessing.active_children()], flush=True)\n"
        "    input()\n"
        "spec = make_spec('edge-n', 'depth', 64, 128, masks=False, keypoints=False)\n"
        "train(spec, TrainSettings(steps=4, batch=2), Path(sys.argv[1]), Path(sys.argv[2]), told,"
        " engine=Engine(precision='fp32', workers=1))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(posts), str(tmp_path / "run")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    workers = [int(word) for word in process.stdout.readline().split()]
    assert workers
    process.kill()
    process.wait()
    for _ in range(150):
        if not any(_alive(worker) for worker in workers):
            break
        time.sleep(0.1)
    assert [worker for worker in workers if _alive(worker)] == []


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_broken_frames_are_left_out_when_asked_and_counted(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    (posts / "depth8/000003.png").write_bytes(b"nothing")
    with pytest.raises(DatasetError, match=r"000003\.png: missing or not a readable image"):
        train(narrow(), plan(), posts, tmp_path / "run")
    val = json.loads((posts / "val_RGB.json").read_text())["images"]
    broken = posts / "depth8" / Path(val[0]["file_name"]).with_suffix(".png").name
    broken.write_bytes(b"nothing")
    said: list[str] = []
    report = train(
        narrow(),
        plan(steps=1),
        posts,
        tmp_path / "run",
        engine=Engine(skip_broken=True),
        preparing=Preparing(say=said.append),
    )
    assert [
        line for line in said if "left out 1 broken frame of train" in line and "000003" in line
    ]
    assert [line for line in said if "1 broken frame of val" in line and broken.name in line]
    assert report.steps == 1


def test_frames_without_depth_are_left_out_when_asked(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, edit_split: Make
) -> None:
    edit_split(posts, "train", lambda content: content["images"][2].pop("depth8_file"))
    with pytest.raises(DatasetError, match=r"000002\.png: the dataset has no 8-bit depth image"):
        train(narrow(), plan(), posts, tmp_path / "run")
    said: list[str] = []
    preparing = Preparing(say=said.append)
    engine = Engine(skip_broken=True)
    for steps in (1, 2):  # the second one opens the cache of the first one
        settings = plan(steps=steps)
        train(narrow(), settings, posts, tmp_path / "run", engine=engine, preparing=preparing)
        (line,) = [line for line in said if "left out 1 broken frame of train" in line]
        assert "000002.png: the dataset has no 8-bit depth image" in line
        said.clear()


def test_an_interrupt_while_the_best_weights_are_saved_comes_after_them(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved: list[Path] = []

    def interrupted(path: Path, *rest: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        save_checkpoint(path, *rest)
        saved.append(path)

    monkeypatch.setattr("perceptree.training.trainer.save_checkpoint", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # workers of pytest have none
    try:
        with pytest.raises(KeyboardInterrupt):
            train(narrow(), plan(steps=1), posts, tmp_path / "run")
    finally:
        signal.signal(signal.SIGINT, before)
    assert saved == [tmp_path / "run/best.safetensors"]
    assert torch.load(tmp_path / "run/state.pt")["best"] is not None


@pytest.mark.parametrize("half", [True, False])
def test_a_lost_or_damaged_checkpoint_is_written_anew_when_resumed(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, weights: Make, half: bool
) -> None:
    report = train(narrow(), plan(steps=2), posts, tmp_path / "run")
    before = weights(report.checkpoint)
    whole = report.checkpoint.read_bytes()
    if half:
        report.checkpoint.write_bytes(whole[: len(whole) // 2])
    else:
        report.checkpoint.unlink()
    said: list[str] = []
    again = train(
        narrow(), plan(steps=2), posts, tmp_path / "run", preparing=Preparing(say=said.append)
    )
    (line,) = said
    assert str(report.checkpoint) in line
    assert "writes it anew" in line
    assert again.metrics == report.metrics
    after = weights(again.checkpoint)
    assert [name for name in before if not torch.equal(before[name], after[name])] == []


@pytest.mark.parametrize(
    ("field", "expected"),
    [
        ("segmentation", "trees have no masks, expected masks, or --no-masks"),
        ("keypoints", "no tree has a labelled keypoint, expected keypoints, or --no-keypoints"),
    ],
)
def test_data_that_lacks_what_the_model_learns_is_refused(
    posts: Path,
    tmp_path: Path,
    narrow: Make,
    plan: Make,
    edit_split: Make,
    field: str,
    expected: str,
) -> None:
    def strip(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            del annotation[field]

    for split in ("train", "val"):
        edit_split(posts, split, strip)
    with pytest.raises(DatasetError, match=r"train_RGB\.json: " + expected):
        train(narrow(), plan(), posts, tmp_path / "run")
    without = {"segmentation": "masks", "keypoints": "keypoints"}[field]
    report = train(narrow(**{without: False}), plan(steps=1), posts, tmp_path / "run")
    assert report.steps == 1


def test_a_gpu_that_is_not_there_is_said(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(SettingsError, match="device is cuda, but there is no GPU"):
        train(narrow(), plan(), posts, tmp_path / "run", engine=Engine(device="cuda"))
