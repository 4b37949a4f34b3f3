"""``perceptree plot``: the picture shows a run's log."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
import pytest

from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec
from perceptree.training import TrainSettings, train, trainer
from perceptree.training.plot import draw_runs, read_curves
from perceptree.training.run_log import EVENTS_NAME, RunLog

Call = Callable[..., tuple[int, str, str]]


def write_log(run: Path, steps: int = 6, lowest: float = 1.0, **losses: float) -> Path:
    """A log with an entry per 50 steps and 30 min, and AP at every second entry."""
    run.mkdir(parents=True)
    entries: list[dict[str, Any]] = []
    for number in range(1, steps + 1):
        at = {"step": 50 * number, "elapsed_s": 1800.0 * number}
        known = {name: value / number for name, value in losses.items()}
        known |= {"score": lowest / number, "box_shift": 2 * lowest / number}
        pace = {"rate": 1e-3, "frames_per_s": 10.0, "waiting_share": 0.01}
        entries.append(at | {"losses": known} | pace)
        if number % 2 == 0:
            val = {"box_ap": 10.0 * number, "mask_ap": 5.0 * number, "keypoint_ap": None}
            entries.append(at | {"val": val})
    log = RunLog(run, 0)
    for entry in entries:
        log.write(entry)
    log.close()
    shutil.rmtree(run / EVENTS_NAME)
    return run


def decoded(png: bytes) -> Any:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def coloured(image: Any, bgr: tuple[int, int, int]) -> int:
    return int((np.abs(image.astype(int) - bgr).max(axis=2) < 8).sum())


def test_curves_hold_what_was_logged(tmp_path: Path) -> None:
    found = read_curves(write_log(tmp_path / "run"), "run")
    boxes = found.curves["AP of boxes on val"]
    assert boxes.steps.tolist() == [100, 200, 300]
    assert boxes.values.tolist() == [20, 40, 60]
    assert len(found.curves["AP of keypoints on val"].steps) == 0
    assert found.curves["total loss"].values[:2].tolist() == [3.0, 1.5]
    assert found.curves["box shift loss"].values[1] == 1.0
    assert found.curves["learning rate"].values.tolist() == [1e-3] * 6
    assert found.hours[-1] == 3.0
    assert found.label == "run: 300 steps, 3.0 h, best AP of boxes 60.0"


def test_the_log_of_a_training_has_all_curves(
    posts: Path,
    tmp_path: Path,
    narrow: Callable[..., ModelSpec],
    plan: Callable[..., TrainSettings],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(trainer, "_LOG_EVERY_STEPS", 1)
    run = tmp_path / "run"
    report = train(narrow(), plan(steps=1), posts, run)
    curves = read_curves(run, "run").curves
    made_up = read_curves(write_log(tmp_path / "made up", mask=1.0), "made up").curves
    assert set(made_up) <= set(curves)
    assert all(curve.steps.tolist() == [1] for curve in curves.values())
    assert curves["AP of boxes on val"].values.tolist() == [report.metrics.box_ap]
    assert coloured(decoded(draw_runs([run])), (180, 119, 31)) > 9


def test_every_run_is_drawn_in_its_colour_and_settings_of_plots_stay(tmp_path: Path) -> None:
    before = {**matplotlib.rcParams, "backend": None}  # it is chosen at its first use
    first = write_log(tmp_path / "first")
    second = write_log(tmp_path / "second", lowest=9.0, mask=3.0)
    blue, orange = (180, 119, 31), (14, 127, 255)
    alone, both = decoded(draw_runs([first])), decoded(draw_runs([first, second]))
    assert coloured(alone, blue) > 500
    assert coloured(alone, orange) == 0
    assert coloured(both, orange) > 500
    assert both.shape[0] > alone.shape[0]  # the mask loss has its own panel
    assert before == {**matplotlib.rcParams, "backend": None}


def test_the_picture_lies_beside_the_log_or_where_it_is_told(call: Call, tmp_path: Path) -> None:
    run = write_log(tmp_path / "run")
    assert call("plot", run) == (0, f"{run / 'plot.png'}\n", "")
    other = tmp_path / "other.png"
    twin = write_log(tmp_path / "deeper/run")
    assert call("plot", run, twin, "--out", other) == (0, f"{other}\n", "")
    assert decoded(other.read_bytes()).shape[1] == decoded((run / "plot.png").read_bytes()).shape[1]
    assert sorted(path.name for path in run.iterdir()) == ["log.jsonl", "plot.png"]


def test_a_run_that_has_just_begun_is_drawn(tmp_path: Path) -> None:
    assert coloured(decoded(draw_runs([write_log(tmp_path / "run", steps=1)])), (180, 119, 31)) > 9
    flat = write_log(tmp_path / "flat", steps=3, lowest=0.0)
    assert decoded(draw_runs([flat])) is not None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", r"log\.jsonl: is empty, expected"),
        ('{"step": 50}\n{"step": 100}\n', r"log\.jsonl: not the log of a training"),
        ('{"step": 50, "elapsed_s": 1, "losses": 3}\n', r"log\.jsonl: not the log of a training"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "log.jsonl").write_text(text)
    with pytest.raises(CheckpointError, match=expected) as caught:
        draw_runs([tmp_path])
    assert "\n" not in str(caught.value)


def test_mistakes_are_told_in_one_line(call: Call, tmp_path: Path) -> None:
    run = write_log(tmp_path / "run")
    code, _, told = call("plot", tmp_path / "none")
    assert (code, told.count("\n")) == (2, 1)
    assert "none/log.jsonl: no such file, expected the folder" in told
    code, _, told = call("plot", run, "--out", tmp_path / "picture.jpg")
    assert (code, told.count("\n")) == (2, 1)
    assert "picture.jpg: expected a name ending in .png" in told
    code, _, told = call("plot", run, "--out", tmp_path / "nowhere/a.png")
    assert (code, told.count("\n")) == (2, 1)
    assert "nowhere/a.png: cannot be written" in told
