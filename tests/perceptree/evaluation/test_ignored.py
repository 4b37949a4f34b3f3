"""Ignored trees count neither way, and reports give recall under both rules."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from perceptree.data import FrameRecord, FrameStore, TreeRecord, read_dataset
from perceptree.errors import DatasetError
from perceptree.evaluation import About, evaluate, make_report, summary_lines
from perceptree.evaluation.groups import DISTANCE, groups_of
from perceptree.evaluation.matching import Pair, match_trees
from perceptree.evaluation.precision import Scorer
from perceptree.evaluation.predictions import FramePrediction
from perceptree.evaluation.reliability import scored_detections
from perceptree.models import TreeRCNN, make_spec, save_checkpoint

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]
Call = Callable[..., tuple[int, str, str]]

MODEL = {"name": "oracle", "modality": "rgb", "precision": "float32", "input_px": [160, 96]}


def tree(left: float, **how: Any) -> TreeRecord:
    box = np.array([left, 0.0, left + 10.0, 40.0])
    return TreeRecord(1, box, np.zeros((5, 3)), None, how.pop("crowd", False), {}, **how)


def frame(*trees: TreeRecord) -> FrameRecord:
    return FrameRecord(7, Path("7.png"), None, None, 200, 50, {}, trees)


def finding(*lefts_and_scores: tuple[float, float]) -> FramePrediction:
    boxes = np.array([[left, 0, left + 10, 40] for left, _ in lefts_and_scores], float)
    scores = np.array([score for _, score in lefts_and_scores])
    return FramePrediction(boxes.reshape(-1, 4), scores, None, None)


@pytest.mark.parametrize("how", [{"crowd": True}, {"marked": True}, {"far": True}])
def test_ignored_trees_are_neither_found_nor_missed_nor_invented(how: dict[str, bool]) -> None:
    frames = [frame(tree(0), tree(50, **how))]
    # On the tree; on the ignored one by 1, 0.5 and 0.4 of the detection; elsewhere.
    found = [finding((0, 0.9), (50, 0.8), (55, 0.7), (56, 0.6), (150, 0.55))]
    matches = match_trees(frames, found)
    assert matches.found == [Pair(0, 0, 0, 1.0)]
    assert matches.missed == []
    assert matches.invented == [(0, 3), (0, 4)]
    assert (matches.recall, matches.precision) == (1.0, pytest.approx(1 / 3))
    assert match_trees(frames, [finding()]).missed == [(0, 0)]
    scored = scored_detections(frames, found)
    assert scored.score.tolist() == [0.9, 0.6, 0.55]
    assert scored.right.tolist() == [True, False, False]


@pytest.mark.parametrize("how", [{"crowd": True}, {"marked": True}, {"far": True}])
def test_ignored_trees_do_not_lower_the_average_precision(how: dict[str, bool]) -> None:
    frames = [frame(tree(0), tree(50, **how), tree(100))]
    # The detection of the ignored tree has the highest score, and a second one is on it, too.
    scorer = Scorer(frames, [finding((50, 0.99), (50, 0.95), (0, 0.9))])
    found = scorer.precision("bbox")
    assert found is not None
    assert found.ap == pytest.approx(100 * 51 / 101)  # one of two, without a false positive
    counted = Scorer([frame(tree(0), tree(50), tree(100))], [finding((50, 0.99), (0, 0.9))])
    whole = counted.precision("bbox")
    assert whole is not None
    assert whole.ap == pytest.approx(100 * 67 / 101)  # two of three


def test_groups_leave_ignored_trees_out() -> None:
    near, marked = tree(0), tree(9, marked=True)
    for each in (near, marked):
        each.truth["distance_m"] = 3.0
    (group,) = groups_of([frame(marked, near)], DISTANCE)
    assert group.trees == {1}


@pytest.fixture
def graded(posts: Path, edit_split: Edit) -> Path:
    """Posts at 3 m, and the last three of nine at 9.5 m."""

    def move(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            annotation["distance_m"] = 9.5 if annotation["id"] > 6 else 3.0

    edit_split(posts, "train", move)
    return posts


def store(posts: Path, certain_m: float | None = None) -> FrameStore:
    dataset = read_dataset(posts, "train", certain_m=certain_m)
    return FrameStore(dataset.frames, make_spec("edge-n", "rgb", 96, 160))


def first_only(raw: Any) -> Any:
    """One detection per frame: frame ``n`` has ``1 + n % 2`` posts."""
    raw.num_detections[:] = 1
    return raw


def test_a_report_gives_recall_under_both_rules(graded: Path, oracle: Any) -> None:
    frames = store(graded, 8.5)
    about = About(MODEL, "posts", "train", (), 8.5)
    report = make_report(oracle(store(graded), first_only), frames, about, 4)
    figures = report.figures
    # Frames 0 to 5 have the trees 1, 2 3, 4, 5 6, 7, 8 9; the first of each is found.
    assert figures["data"]["trees"] == 6
    assert (figures["data"]["ignored"], figures["data"]["crowds"]) == (3, 0)
    certain = figures["certain"]
    assert certain["certain_m"] == 8.5
    assert certain["graded"] == {
        "found": 4,
        "missed": 2,
        "invented": 0,
        "recall": 0.6667,
        "precision": 1.0,
        "by_distance": [{"name": "2.5 to 5 m", "trees": 6, "found": 4, "recall": 0.6667}],
    }
    assert certain["plain"]["by_distance"] == [
        {"name": "2.5 to 5 m", "trees": 6, "found": 4, "recall": 0.6667},
        {"name": "7.5 to 10 m", "trees": 3, "found": 2, "recall": 0.6667},
    ]
    assert (certain["plain"]["found"], certain["plain"]["missed"]) == (6, 3)
    assert figures["at_score"]["found"] == 4
    assert [group["trees"] for group in figures["by"]["distance_m"]["groups"]] == [6]
    lines = list(summary_lines(figures))
    assert max(map(len, lines)) <= 100
    assert (
        "with trees beyond 8.5 m counted: 6 of 9 trees found (67%), 0 of 6 false positives" in lines
    )
    assert "  7.5 to 10 m  2 of 3 found (67%); to 8.5 m –" in lines


def test_the_page_shows_both_rules(graded: Path, oracle: Any, tmp_path: Path) -> None:
    frames = store(graded, 8.5)
    about = About(MODEL, "posts", "train", (), 8.5)
    report = make_report(oracle(store(graded), first_only), frames, about, 4)
    html = report.write(tmp_path).read_text("utf-8")
    assert "Recall by distance under both rules" in html
    assert "All counted: 6 of 9 trees found, 0 false positives." in html


def test_detections_of_far_trees_are_false_positives_under_no_rule(
    graded: Path, oracle: Any
) -> None:
    frames = store(graded, 8.5)
    metrics = evaluate(oracle(store(graded)), frames)
    assert (metrics.trees, metrics.recall, metrics.precision) == (6, 1.0, 1.0)
    assert metrics.box_ap == pytest.approx(100)
    assert metrics.mask_ap == pytest.approx(100)
    assert metrics.keypoint_ap == pytest.approx(100)


def test_frames_whose_trees_are_all_ignored_cannot_be_evaluated(posts: Path, oracle: Any) -> None:
    frames = store(posts, 4.0)  # posts are at 5 m
    message = r"6 frames without a tree that counts \(9 are ignored\): expected at least one"
    with pytest.raises(DatasetError, match=message):
        evaluate(oracle(frames), frames)


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    torch.manual_seed(3)
    path = tmp_path / "model.safetensors"
    model = TreeRCNN(make_spec("edge-n", "rgb", 64, 96, fpn_width=16))
    save_checkpoint(path, model.eval(), {"data": "none"})
    return path


def test_the_command_grades_alone_and_in_shards(
    call: Call, checkpoint: Path, graded: Path, tmp_path: Path
) -> None:
    options = ("eval", checkpoint, graded, "--split", "train", "--certain", 8.5, "--json")
    code, alone, told = call(*options)
    assert code == 0, told
    code, sharded, told = call(*options, "--shards", tmp_path / "parts")
    assert code == 0, told
    assert alone == sharded
    assert '"certain": {"certain_m": 8.5, "graded": ' in alone
    assert "3 of 9 annotations are ignored: 3 beyond 8.5 m" in alone


def test_the_command_refuses_what_cannot_be_graded(
    call: Call, checkpoint: Path, posts: Path, edit_split: Edit
) -> None:
    options = ("eval", checkpoint, posts, "--split", "train", "--certain")
    code, _, told = call(*options, 0)
    assert code == 2
    assert told == "perceptree: certain distance is 0.0 m: expected more than 0, or none\n"
    edit_split(posts, "train", lambda c: [a.pop("distance_m") for a in c["annotations"]])
    code, _, told = call(*options, 8.5)
    assert code == 2
    assert "no tree has a distance_m, expected distances to ignore trees beyond 8.5 m\n" in told
