"""Training on a dataset while it is being simulated."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from fake_python import replace_python

from basetree.errors import SettingsError
from perceptree.errors import DatasetError
from perceptree.training import Status, train_while_simulating
from perceptree.training.growing import _frames_in

Make = Callable[..., Any]
WriteDataset = Callable[..., Path]

# A `perceptree synth` that waits until training has begun, then adds the frames held back.
EXTEND = """
import json, pathlib, sys, time
here = pathlib.Path(__file__).parent
(here / "asked.json").write_text(json.dumps(sys.argv[1:]))
while not (here / "run/stage-1/log.jsonl").exists():
    time.sleep(0.02)
(here / "posts/all.json").replace(here / "posts/train_RGB.json")
"""


@pytest.fixture
def grown_later(
    write_dataset: WriteDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A dataset to which its simulation adds half of the train frames later."""
    posts = write_dataset(train=8, val=3, test=1)
    labels, later = posts / "train_RGB.json", posts / "all.json"
    content = json.loads(labels.read_text())
    later.write_text(json.dumps(content))
    kept = {image["id"] for image in content["images"][:4]}
    content["images"] = content["images"][:4]
    content["annotations"] = [a for a in content["annotations"] if a["image_id"] in kept]
    labels.write_text(json.dumps(content))
    (posts / "settings.json").write_text(json.dumps({"seed": 5, "files": {"image_format": "png"}}))
    replace_python(monkeypatch, tmp_path, EXTEND)
    return posts


def test_it_goes_on_with_the_larger_dataset_as_soon_as_it_is_there(
    grown_later: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    seen: list[Status] = []
    larger = 0

    def watch(status: Status) -> None:
        nonlocal larger
        seen.append(status)
        larger += (tmp_path / "run/stage-2").exists()
        if larger == 4:
            raise KeyboardInterrupt

    settings = plan(minutes=30, evaluate_every_steps=3)
    with pytest.raises(KeyboardInterrupt):
        train_while_simulating(narrow(), settings, grown_later, 12, tmp_path / "run", watch)
    words = json.loads((tmp_path / "asked.json").read_text())
    assert words[:3] == ["-m", "perceptree", "synth"]
    asked = {"--frames": "12", "--seed": "5", "--out": str(grown_later), "--image-format": "png"}
    assert asked.items() <= dict(zip(words[4::2], words[5::2], strict=True)).items()
    first, second = (torch.load(tmp_path / f"run/stage-{n}/state.pt") for n in (1, 2))
    # No step was lost or repeated, and the time continued.
    assert second["first_step"] == first["step"] >= 3
    assert second["step"] == first["step"] + 4
    assert [status.step for status in seen] == list(range(1, second["step"] + 1))
    shares = [status.done for status in seen]
    assert shares == sorted(shares)
    assert seen[-1].elapsed_s == pytest.approx(first["elapsed_s"] + second["elapsed_s"])
    learned = [json.loads(state["identity"])["data"]["train"] for state in (first, second)]
    assert learned == [4, 8]


def test_frames_are_counted_without_a_test_split(grown_later: Path) -> None:
    (grown_later / "test_RGB.json").unlink()
    assert _frames_in(grown_later) == 4 + 3


def test_a_run_whose_minutes_are_over_says_so(
    grown_later: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    settings = plan(minutes=0.02, evaluate_every_steps=3)
    train_while_simulating(narrow(), settings, grown_later, 12, tmp_path / "run")
    with pytest.raises(SettingsError, match=r"^minutes is 0\.02, which .*run has used up"):
        train_while_simulating(narrow(), settings, grown_later, 12, tmp_path / "run")


def test_a_simulation_that_fails_ends_the_training_with_its_reason(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    # The posts were not simulated: other settings than those of the folder are refused.
    (posts / "settings.json").write_text(
        json.dumps(
            {"settings": {"no": 1}, "seed": 1, "files": {"image_format": "jpg"}, "sha256": ""}
        )
    )
    with pytest.raises(
        DatasetError, match=r"^the simulation failed: .*settings\.json: no is no setting"
    ):
        train_while_simulating(narrow(), plan(minutes=3), posts, 20, tmp_path / "run")
    assert torch.load(tmp_path / "run/stage-1/state.pt", weights_only=True)["step"] > 0


def test_data_that_was_not_simulated_cannot_grow(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make
) -> None:
    with pytest.raises(
        DatasetError, match=r"settings\.json: not readable as settings, expected a dataset of"
    ):
        train_while_simulating(narrow(), plan(minutes=1), posts, 20, tmp_path / "run")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, "minutes is not given: expected a time limit"),
        ({"minutes": 1, "schedule": "cosine"}, "schedule is cosine: expected constant or steps"),
    ],
)
def test_settings_that_do_not_allow_stages_are_refused(
    posts: Path, tmp_path: Path, narrow: Make, plan: Make, changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(SettingsError, match=told):
        train_while_simulating(narrow(), plan(**changes), posts, 20, tmp_path / "run")


def test_simulate_excludes_branch(call: Make) -> None:
    code, _, told = call(
        "train", "data", "--out", "run", "--simulate", 9, "--minutes", 1, "--branch", "run"
    )
    assert (code, told) == (
        2,
        "perceptree: --simulate excludes --branch: expected one of the two\n",
    )


@pytest.mark.slow
def test_the_command_simulates_and_trains_at_once(call: Make, tmp_path: Path) -> None:
    size = ("--width", 160, "--height", 96, "--views", 1)
    assert call("synth", "--out", tmp_path / "data", "--frames", 8, *size)[0] == 0
    code, out, told = call(
        "train",
        tmp_path / "data",
        "--out",
        tmp_path / "run",
        "--simulate",
        16,
        "--minutes",
        2,
        "--width",
        128,
        "--height",
        64,
        "--batch",
        2,
        "--evaluate-every",
        20,
        "--json",
    )
    assert code == 0, told
    assert json.loads(out)["checkpoint"] == str(tmp_path / "run/stage-2/best.safetensors")
    assert "stage-2: 16 frames" in told
