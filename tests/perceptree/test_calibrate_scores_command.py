"""``perceptree calibrate-scores``: a checkpoint whose scores are probabilities."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from perceptree.commands import calibrate_scores as command
from perceptree.evaluation import reliability
from perceptree.evaluation.reliability import Scored, ScoreScale
from perceptree.models import TreeRCNN, load_checkpoint, make_spec, save_checkpoint

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    torch.manual_seed(3)
    model = TreeRCNN(
        make_spec("edge-n", "rgb", 64, 96, fpn_width=32, backbone="mobilenetv4_conv_small")
    )
    torch.nn.init.normal_(model.box_head.score.weight)
    path = tmp_path / "raw.safetensors"
    save_checkpoint(path, model.eval(), {"data": "none"})
    return path


def score_of(checkpoint: Path) -> np.ndarray:
    head = load_checkpoint(checkpoint)[0].box_head
    cells = head.hidden[0].in_features
    regions = torch.linspace(-1, 1, 20 * cells).reshape(20, -1, 7, 7)
    return np.asarray(head(regions)[0].softmax(1)[:, 0].detach())


def test_the_new_checkpoint_has_scaled_scores_and_says_how(
    call: Call, checkpoint: Path, posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(0)
    score = random.uniform(0.05, 0.95, 5000)
    certainty = random.uniform(0.5, 0.95, 5000)
    drawn = Scored(score, score > 0, score, certainty)
    right = random.random(5000) < ScoreScale(0.5, -0.4, 0.3).apply(drawn)
    drawn = drawn._replace(right=right, iou=0.8 * right)
    monkeypatch.setattr(reliability, "scored_detections", lambda *_: drawn)
    out = tmp_path / "calibrated.safetensors"
    code, told, _ = call("calibrate-scores", checkpoint, posts, "--split", "val", "--out", out)
    assert code == 0
    assert "5000 detections" in told
    model, content = load_checkpoint(out)
    record = content["training"]
    fitted = record["score_calibration"]
    assert record["data"] == "none"
    scale = ScoreScale(*(fitted[name] for name in ("slope", "offset", "mask")))
    assert scale == pytest.approx((0.5, -0.4, 0.3), abs=0.1)
    assert model.spec.mask_score_weight == scale.mask
    assert fitted["expected_error"][1] < 0.02 < fitted["expected_error"][0]
    before = score_of(checkpoint)
    scaled = scale.apply(Scored(before, before > 0, before))
    np.testing.assert_allclose(score_of(out), scaled, atol=1e-4)
    again = tmp_path / "again.safetensors"
    assert call("calibrate-scores", out, posts, "--split", "val", "--out", again)[0] == 0
    expected = scale.slope * scale.mask + scale.mask
    assert load_checkpoint(again)[0].spec.mask_score_weight == pytest.approx(expected)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--split", "exam"), "--split is 'exam'"),
        (("--out", "new.onnx"), "expected a file name ending in .safetensors"),
        ((), "expected 100 or more of both"),
    ],
)
def test_mistakes_give_one_line_and_no_file(
    call: Call,
    checkpoint: Path,
    posts: Path,
    tmp_path: Path,
    options: tuple[str, ...],
    what: str,
) -> None:
    out = tmp_path / "new.safetensors"
    given = options if "--out" in options else ("--out", out, *options)
    code, _, told = call("calibrate-scores", checkpoint, posts, *given)
    assert code == 2
    assert what in told
    assert told.count("\n") == 1
    assert not out.exists()


def test_trees_beyond_a_distance_are_ignored_where_distances_are_known(
    posts: Path, edit_split: Callable[..., None]
) -> None:
    def ignored(certain_m: float | None) -> int:
        frames = command._frames(posts, "val", certain_m)
        return sum(tree.ignored for frame in frames for tree in frame.trees)

    assert ignored(8.5) == 0

    def move(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            annotation["distance_m"] = 9.0 if annotation["id"] % 2 else 5.0

    edit_split(posts, "val", move)
    assert ignored(None) == 0
    assert ignored(8.5) > 0
