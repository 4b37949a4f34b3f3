"""Average precision, compared with pycocotools; also for subsets."""

import contextlib
import dataclasses
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

import calib
from perceptree.data import FrameRecord, TreeRecord, read_split
from perceptree.evaluation import RawDetections, evaluate, predict_frames
from perceptree.evaluation.precision import SIZES_PX2, Scorer
from perceptree.evaluation.predictions import FramePrediction

DatasetWriter = Callable[..., Path]
Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]
NAMES = {"bbox": "box", "segm": "mask", "keypoints": "keypoint"}
SCALE = 1.25  # model px per source px


def worse(seed: int) -> Callable[[RawDetections], RawDetections]:
    """Shift everything, change scores and add false positives."""
    rng = np.random.default_rng(seed)

    def change(raw: RawDetections) -> RawDetections:
        assert raw.keypoints is not None
        raw.boxes[:] += rng.normal(0, 2.5, raw.boxes.shape)
        raw.boxes[:] = np.sort(raw.boxes.reshape(*raw.boxes.shape[:2], 2, 2), axis=2).reshape(
            raw.boxes.shape
        )
        raw.keypoints[..., :2] += rng.normal(0, 6, raw.keypoints[..., :2].shape)
        for row, trees in enumerate(raw.num_detections):
            corner = rng.uniform(0, 60, (2, 2))
            raw.boxes[row, trees : trees + 2] = np.hstack([corner, corner + rng.uniform(8, 30)])
            raw.masks[row, trees : trees + 2] = 1.0  # type: ignore[index]
        raw.num_detections[:] += 2
        scores = np.sort(rng.uniform(0.05, 1, raw.scores.shape))[:, ::-1]
        raw.scores[:] = scores
        return raw

    return change


def remembering(predict: Any, into: list[RawDetections]) -> Any:
    """The same detector; its outputs are stored."""

    def both(images: np.ndarray) -> RawDetections:
        into.append(predict(images))
        return into[-1]

    return both


def by_hand(posts: Path, raws: list[RawDetections], kind: str) -> COCOeval:
    """Evaluate with pycocotools, directly from the dataset's file and the model's output."""
    content = json.loads((posts / "train_RGB.json").read_text())
    entries = []
    for image, raw in zip(content["images"], raws, strict=True):
        assert raw.keypoints is not None
        for row in range(int(raw.num_detections[0])):
            box = raw.boxes[0, row].astype(float) / SCALE
            pasted = pasted_box(box, image["width"], image["height"])
            x0, y0 = max(box[0], 0), max(box[1], 0)
            x1, y1 = min(box[2], image["width"]), min(box[3], image["height"])
            points = raw.keypoints[0, row].astype(float)
            points[:, :2] = points[:, :2] / SCALE - 0.5
            value: dict[str, Any] = {
                "bbox": [x0, y0, x1 - x0, y1 - y0],
                "segm": coco_mask.encode(np.asfortranarray(pasted)),
                "keypoints": points.ravel().tolist(),
            }
            key = "segmentation" if kind == "segm" else kind
            entry = {"image_id": image["id"], "category_id": 1, key: value[kind]}
            entries.append(entry | {"score": float(raw.scores[0, row])})
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO(posts / "train_RGB.json")
        hand = COCOeval(truth, truth.loadRes(entries), kind)
        if kind == "keypoints":
            hand.params.kpt_oks_sigmas = np.full(5, 0.25)
        hand.evaluate()
        hand.accumulate()
        hand.summarize()
    return hand


def pasted_box(box: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return a mask of the pixels whose centres are in the box."""
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    inside = ((x >= box[0]) & (x <= box[2]))[None] & ((y >= box[1]) & (y <= box[3]))[:, None]
    return inside.astype(np.uint8)


@pytest.mark.parametrize("kind", ["bbox", "segm", "keypoints"])
def test_precision_equals_pycocotools(
    write_dataset: DatasetWriter, store_of: Any, oracle: Any, kind: str
) -> None:
    posts = write_dataset(train=30)
    store = store_of(posts)
    raws: list[RawDetections] = []
    predictions = list(predict_frames(remembering(oracle(store, worse(4)), raws), store, batch=1))
    found = Scorer(store.frames, predictions).precision(kind)  # type: ignore[arg-type]
    assert found is not None
    hand = by_hand(posts, raws, kind).stats
    assert 5 < found.ap < 95  # the comparison is not trivial
    ours = [found.ap, found.ap50, found.ap75]
    assert ours == pytest.approx((100 * hand[:3]).tolist(), abs=1e-9)
    if kind != "keypoints":  # COCO's summary has other sizes for keypoints
        sizes = found.ap_small, found.ap_medium, found.ap_large
        ours = [-1 if ap is None else ap / 100 for ap in sizes]
        assert ours == pytest.approx(hand[3:6].tolist(), abs=1e-9)
    metrics = evaluate(oracle(store, worse(4)), store).to_dict()
    assert metrics[f"{NAMES[kind]}_ap"] == pytest.approx(100 * hand[0], abs=1e-9)
    assert metrics[f"{NAMES[kind]}_ap50"] == pytest.approx(100 * hand[1], abs=1e-9)


def tree(left: float, crowd: bool = False) -> TreeRecord:
    box = np.array([left, 0.0, left + 10.0, 40.0])
    outline = [[left, 0, left + 10, 0, left + 10, 40, left, 40]]
    return TreeRecord(1, box, np.zeros((5, 3)), outline, crowd, {})


def frame(number: int, *trees: TreeRecord) -> FrameRecord:
    return FrameRecord(number, Path(f"{number}.png"), None, None, 100, 50, {}, trees)


def finding(*lefts_and_scores: tuple[float, float]) -> FramePrediction:
    boxes = np.array([[left, 0, left + 10, 40] for left, _ in lefts_and_scores], float)
    scores = np.array([score for _, score in lefts_and_scores])
    return FramePrediction(boxes.reshape(-1, 4), scores, None, None)


def test_trees_of_other_groups_are_ignored() -> None:
    # Two near trees are found, and one of two far trees with a lower score.
    frames = [frame(1, tree(0), tree(50)), frame(2, tree(20), tree(70))]
    found = [finding((0, 0.9), (50, 0.8)), finding((20, 0.7))]
    scorer = Scorer(frames, found)
    near, far = {0, 2}, {1, 3}
    assert scorer.part("bbox", near, {0, 1}) == pytest.approx(100)
    # One of two, without a false positive: precision 1 up to a recall of 0.5.
    assert scorer.part("bbox", far, {0, 1}) == pytest.approx(100 * 51 / 101)
    assert scorer.part("bbox", far, {0}) == pytest.approx(100)
    assert scorer.part("bbox", set(), {0, 1}) is None


def test_the_subset_of_everything_equals_the_whole() -> None:
    frames = [frame(number, tree(0), tree(30), tree(60)) for number in range(4)]
    found = [finding((0, 0.9), (31, 0.6), (90, 0.7)) for _ in frames]
    scorer = Scorer(frames, found)
    whole = scorer.precision("bbox")
    assert whole is not None
    assert scorer.part("bbox", set(range(12)), set(range(4))) == pytest.approx(whole.ap)


def test_false_positives_count_in_every_subset() -> None:
    frames = [frame(1, tree(0), tree(50))]
    sure_alarm = [finding((85, 0.99), (0, 0.9), (50, 0.8))]
    scorer = Scorer(frames, sure_alarm)
    for part in ({0}, {1}):
        assert scorer.part("bbox", part, {0}) == pytest.approx(50)


def test_recall_and_precision_by_score() -> None:
    frames = [frame(1, tree(0), tree(30)), frame(2, tree(0, crowd=True))]
    found = [finding((0, 0.9), (60, 0.5), (30, 0.3)), finding((1, 0.8))]
    rows = Scorer(frames, found).by_score("bbox")
    assert rows is not None
    at = {row["score"]: (row["recall"], row["precision"]) for row in rows}
    assert at[0.95] == (0.0, None)
    assert at[0.6] == (0.5, 1.0)  # detections in the crowd are ignored
    assert at[0.4] == (0.5, 0.5)
    assert at[0.05] == (1.0, pytest.approx(2 / 3))


def test_trees_without_a_mask_are_ignored_for_masks_only(
    posts: Path, edit_split: Edit, store_of: Any, oracle: Any
) -> None:
    def unmask(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            del annotation["segmentation"]

    store = store_of(posts)
    found = list(predict_frames(oracle(store), store, 4))
    edit_split(posts, "train", unmask)
    scorer = Scorer(read_split(posts, "train"), found)
    assert scorer.precision("segm") is None
    boxes = scorer.precision("bbox")
    assert boxes is not None
    assert boxes.ap == pytest.approx(100)


def pycocotools_of(frames: list[FrameRecord], found: list[FramePrediction], kind: str) -> COCOeval:
    """The evaluation of boxes of 10x40 px by pycocotools alone."""
    truth, guesses = [], []
    for record, prediction in zip(frames, found, strict=True):
        common = {"image_id": record.image_id, "category_id": 1}
        for label in record.trees:
            left, top, right, bottom = label.box_px.tolist()
            values = {
                "bbox": [left, top, right - left, bottom - top],
                "area": 400.0,
                "segmentation": label.segmentation,
                "keypoints": label.keypoints.ravel().tolist(),
                "num_keypoints": 5,
                "iscrowd": int(label.ignored),
            }
            truth.append({"id": len(truth) + 1, **common, **values})
        for row, box in enumerate(prediction.boxes):
            value: dict[str, Any] = {
                "bbox": {"bbox": [*box[:2], *(box[2:] - box[:2])]},
                "segm": {"segmentation": dict(prediction.masks[row])},  # type: ignore[index]
                "keypoints": {"keypoints": prediction.keypoints[row].ravel()},  # type: ignore[index]
            }
            guesses.append({**common, **value[kind], "score": prediction.scores[row]})
    coco = COCO()
    coco.dataset = {
        "info": {},
        "images": [{"id": f.image_id, "width": f.width, "height": f.height} for f in frames],
        "annotations": truth,
        "categories": [{"id": 1, "name": "tree"}],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        coco.createIndex()
        evaluation = COCOeval(coco, coco.loadRes(guesses), kind)
        evaluation.params.areaRng = [list(limits) for limits in SIZES_PX2.values()]
        evaluation.params.areaRngLbl = list(SIZES_PX2)
        if kind == "keypoints":
            evaluation.params.kpt_oks_sigmas = np.full(5, 0.25)
        evaluation.evaluate()
        evaluation.accumulate()
    return evaluation


def counted(images: list[dict[str, Any] | None], score: float) -> tuple[int, int, int]:
    """Right detections and all of at least a score, and all trees, at an overlap of 0.50."""
    right = shown = trees = 0
    for image in (image for image in images if image is not None):
        counts = ~image["dtIgnore"][0].astype(bool) & (np.array(image["dtScores"]) >= score)
        right += int((image["dtMatches"][0] > 0)[counts].sum())
        shown += int(counts.sum())
        trees += int((np.array(image["gtIgnore"]) == 0).sum())
    return right, shown, trees


@pytest.mark.parametrize("kind", ["bbox", "segm", "keypoints"])
def test_matches_equal_pycocotools_in_every_case(kind: str) -> None:
    """Crowds, equal overlaps and scores, sizes and crowded frames, on a coarse grid."""
    rng = np.random.default_rng(11)
    frames, found = [], []
    for number in range(60):
        points = rng.integers(0, 90, (6, 5, 2)).astype(float)
        labels = [
            dataclasses.replace(
                tree(10.0 * rng.integers(0, 4), bool(rng.uniform() < 0.2)),
                keypoints=np.dstack([points[index][None], np.full((1, 5, 1), 2)])[0],
            )
            for index in range(rng.integers(0, 6))
        ]
        frames.append(frame(number, *labels))
        count = int(rng.integers(0, 8))
        boxes = np.array([[x, 0, x + 10, 40] for x in 2.0 * rng.integers(0, 18, count)])
        scores = np.sort(rng.integers(1, 6, count) / 5)[::-1]
        masks = [calib.encode_rle(pasted_box(box, 100, 50).astype(bool)) for box in boxes]
        guess = points[rng.integers(0, 6, count)] + rng.integers(-5, 6, (count, 1, 2))
        guess = np.concatenate([guess, np.ones((count, 5, 1))], axis=2)
        found.append(FramePrediction(boxes.reshape(-1, 4), scores, guess, masks))
    scorer, theirs = Scorer(frames, found), pycocotools_of(frames, found, kind)
    values = 100 * theirs.eval["precision"][:, :, 0, :, -1]  # (overlaps, recalls, sizes)
    ours = scorer.precision(kind)  # type: ignore[arg-type]
    assert ours is not None
    whole, *sizes = np.moveaxis(values, -1, 0)
    assert ours.ap == pytest.approx(whole.mean())
    assert (ours.ap50, ours.ap75) == pytest.approx((whole[0].mean(), whole[5].mean()))
    expected = [None if (size < 0).any() else pytest.approx(size.mean()) for size in sizes]
    assert [ours.ap_small, ours.ap_medium, ours.ap_large] == expected
    curve = scorer.curve(kind)  # type: ignore[arg-type]
    assert curve == pytest.approx(whole[0] / 100)
    assert len(np.unique(values)) > 10  # the comparison is not trivial
    for row in scorer.by_score(kind) or []:  # type: ignore[arg-type]
        right, shown, trees = counted(theirs.evalImgs[: len(frames)], float(row["score"] or 0))
        assert row["recall"] == pytest.approx(right / trees)
        assert row["precision"] == (pytest.approx(right / shown) if shown else None)
