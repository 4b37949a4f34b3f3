import numpy as np
import pytest

from edgetree.export.comparison import Arrays, compare_frame, compare_frames
from edgetree.export.limits import limits_of
from edgetree.export.parity import FrameParity, ParityReport

ROWS = 4


def outputs(boxes: list[list[float]], scores: list[float]) -> dict[str, np.ndarray]:
    count = len(scores)
    result = {
        "boxes": np.zeros((1, ROWS, 4), np.float32),
        "scores": np.zeros((1, ROWS), np.float32),
        "keypoints": np.zeros((1, ROWS, 5, 3), np.float32),
        "keypoint_stds": np.zeros((1, ROWS, 5, 2), np.float32),
        "masks": np.zeros((1, ROWS, 28, 28), np.float32),
        "num_detections": np.array([count]),
    }
    result["boxes"][0, :count] = np.reshape(boxes, (-1, 4))
    result["scores"][0, :count] = scores
    result["masks"][0, :count, :14] = 0.9
    return result


LEFT, RIGHT = [0.0, 0, 20, 100], [200.0, 0, 230, 100]
IMAGE = {"frame": np.zeros((8, 8), np.uint8)}


def compared(
    expected: Arrays, found: Arrays, precision: str = "float32"
) -> tuple[FrameParity, ...]:
    return compare_frames(lambda _: expected, lambda _: found, IMAGE, precision, 0.01)


def faults(expected: Arrays, found: Arrays, precision: str = "float32") -> list[str]:
    frames = compared(expected, found, precision)
    return ParityReport(precision, frames, limits=limits_of(precision)).faults()


def test_equal_detections_pass_in_any_order() -> None:
    expected = outputs([LEFT, RIGHT], [0.9, 0.8999])
    assert faults(expected, expected) == []
    assert faults(expected, outputs([RIGHT, LEFT], [0.8999, 0.9])) == []


def test_frames_without_trees_are_a_fault() -> None:
    assert faults(outputs([], []), outputs([], [])) == [
        "all: no tree to compare, expected frames in which the model finds some"
    ]


@pytest.mark.parametrize(
    ("name", "index", "change", "message"),
    [
        ("boxes", (0, 0, 2), 0.6, "frame: box_px differs by 0.6, limit 0.5"),
        ("scores", (0, 0), -0.002, "score differs by 0.002"),
        ("keypoints", (0, 1, 3, 1), 0.7, "keypoint_px differs by 0.7"),
        ("keypoints", (0, 1, 3, 2), 0.01, "keypoint_score differs by 0.01"),
        ("masks", (0, 0, slice(14, 16)), 0.9, "mask_iou is 0.875"),
        ("boxes", (0, 1), 300.0, "matched"),
    ],
)
def test_each_kind_of_difference_is_seen(
    name: str, index: tuple[int, ...], change: float, message: str
) -> None:
    expected = outputs([LEFT, RIGHT], [0.9, 0.5])
    found = {key: value.copy() for key, value in expected.items()}
    found[name][index] += change
    assert any(message in fault for fault in faults(expected, found))


def with_moved_keypoints(moved: int, score_change: float = 0.0) -> ParityReport:
    """60 frames with 600 keypoints in all, of which some lie 5 px away in the file."""
    frames: list[FrameParity] = []
    for frame in range(60):
        expected, found = (outputs([LEFT, RIGHT], [0.9, 0.5]) for _ in range(2))
        if frame < moved:
            found["keypoints"][0, 0, 2] += (5.0, 0.0, score_change)
        frames += compared(expected, found)
    return ParityReport("float32", tuple(frames), limits=limits_of("float32"))


def test_rounding_may_decide_between_equal_peaks_of_a_heat_map() -> None:
    report = with_moved_keypoints(1)
    assert report.faults() == []
    assert "keypoints elsewhere with the same score: 1 of 600, limit 0.5%" in report.table()
    assert report.figures()["keypoint_ties"] == 1
    assert report.figures()["keypoint_px_max"] == 5.0


@pytest.mark.parametrize(("moved", "score_change"), [(4, 0.0), (1, 0.002)])
def test_keypoints_elsewhere_are_a_fault_if_many_or_of_another_score(
    moved: int, score_change: float
) -> None:
    faults = with_moved_keypoints(moved, score_change).faults()
    assert any("keypoint_px differs by 5, limit 0.5" in fault for fault in faults)


def test_a_tree_at_the_threshold_may_be_missing() -> None:
    expected = outputs([LEFT, RIGHT], [0.9, 0.0105])
    assert faults(expected, outputs([LEFT], [0.9])) == []
    assert faults(outputs([LEFT], [0.9]), expected) == []
    assert faults(outputs([LEFT, RIGHT], [0.9, 0.02]), outputs([LEFT], [0.9])) != []


def test_the_last_of_full_rows_may_differ_at_equal_score() -> None:
    boxes = [[100.0 * i, 0, 100.0 * i + 20, 100] for i in range(5)]
    expected = outputs(boxes[:4], [0.9, 0.8, 0.7, 0.3])
    assert faults(expected, outputs([*boxes[:3], boxes[4]], [0.9, 0.8, 0.7, 0.3])) == []
    assert faults(expected, outputs(boxes[1:5], [0.9, 0.8, 0.7, 0.3])) != []


def test_int8_compares_confident_trees_in_both_directions() -> None:
    expected = outputs([LEFT, RIGHT], [0.9, 0.3])
    assert faults(expected, outputs([LEFT], [0.86]), "int8") == []
    assert faults(expected, outputs([LEFT], [0.3]), "int8") != []
    assert faults(expected, outputs([LEFT, RIGHT], [0.9, 0.8]), "int8") != []
    moved = [LEFT[0] + 5, *LEFT[1:]]
    assert faults(expected, outputs([moved], [0.9]), "int8") != []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda o: o["scores"].__setitem__((0, 0), np.nan), "scores is not finite"),
        (lambda o: o["num_detections"].__setitem__(0, 9), "num_detections is 9"),
        (lambda o: o["boxes"].__setitem__((0, 3), 1.0), "rows past num_detections are not zero"),
        (lambda o: o.pop("masks"), "masks is missing"),
    ],
)
def test_invalid_outputs_are_a_fault_even_on_a_blank_frame(change: object, message: str) -> None:
    expected, found = outputs([LEFT], [0.9]), outputs([LEFT], [0.9])
    change(found)  # type: ignore[operator]
    compared = compare_frames(
        lambda _: expected, lambda _: found, {"blank": IMAGE["frame"]}, "float32", 0.01
    )
    (fault,) = ParityReport("float32", compared, limits=limits_of("float32")).faults()
    assert message in fault


@pytest.mark.parametrize(
    ("name", "index", "change", "message"),
    [
        ("scores", 0, -0.1, "score_median is 0.1, limit 0.05"),
        ("keypoints", (0, slice(3), 1), 10.0, "keypoint_shift_median is"),
        ("keypoints", (0, slice(2), 0), 20.0, "keypoint_shift_p90 is 0.4472, limit 0.15"),
        ("keypoints", (0, slice(None), 2), 0.1, "keypoint_score_median is 0.1"),
        ("keypoint_stds", (0, slice(3), 1), 10.0, "keypoint_std_median is 0.2236, limit 0.04"),
        ("keypoint_stds", (0, slice(2), 0), 20.0, "keypoint_std_p90 is 0.4472, limit 0.15"),
        ("masks", (0, slice(0, 14)), -0.1, "mask_probability_median is 0.05, limit 0.04"),
        ("masks", (0, slice(0, 3)), -0.9, "mask_iou_median is 0.7857, limit 0.85"),
        ("masks", (0, slice(0, 7)), -0.9, "mask_iou_p10 is 0.5, limit 0.6"),
    ],
)
def test_int8_differences_of_a_single_tree_are_seen(
    name: str, index: tuple[int, ...], change: float, message: str
) -> None:
    expected, found = outputs([LEFT], [0.9]), outputs([LEFT], [0.9])
    found[name][0][index] += change
    assert any(message in fault for fault in faults(expected, found, "int8"))


def test_one_keypoint_of_a_tree_and_one_mask_of_two_may_be_wrong_in_int8() -> None:
    expected, found = outputs([LEFT, RIGHT], [0.9, 0.9]), outputs([LEFT, RIGHT], [0.9, 0.9])
    found["keypoints"][0, 1, 2, :2] += 80.0
    found["masks"][0, 0] = 0.0
    assert faults(expected, found, "int8") == []


def test_lost_average_precision_is_a_fault() -> None:
    precision = {"box": (60.0, 58.5), "mask": (30.0, 29.5)}
    frames = (FrameParity("f", trees=2, matched=2),)
    report = ParityReport("int8", frames, precision, limits_of("int8"))
    assert report.faults() == ["all: box AP fell from 60.00 to 58.50, limit 1"]


def test_pairs_are_counted_in_both_directions() -> None:
    rows = {"boxes": np.array([LEFT], np.float32), "scores": np.array([0.9]), "rows": np.array(4)}
    frame = compare_frame("f", rows, rows, "float32", 0.01)
    assert (frame.trees, frame.matched) == (2, 2)


@pytest.mark.parametrize("broken", [0, 2, 5, 8])
def test_a_fault_in_one_row_of_a_batch_names_the_right_frame(broken: int) -> None:
    """Nine frames in batches of four: the last batch is filled up with the first three frames."""
    frames = {f"frame {n}": np.full((8, 8), n, np.uint8) for n in range(9)}
    sizes = []

    def detect(images: np.ndarray, moved_px: float) -> dict[str, np.ndarray]:
        sizes.append(len(images))
        rows = []
        for image in images:
            move = moved_px if image[0, 0] == broken else 0.0
            rows.append(outputs([[LEFT[0] + move, *LEFT[1:]], RIGHT], [0.9, 0.8]))
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}

    compared = compare_frames(
        lambda images: detect(images, 0.0),
        lambda images: detect(images, 3.0),
        frames,
        "float32",
        0.01,
        batch=4,
    )
    assert set(sizes) == {4}
    assert [frame.name for frame in compared] == list(frames)
    assert [frame.trees for frame in compared] == [4] * 9
    report = ParityReport("float32", compared, limits=limits_of("float32"))
    assert report.faults() == [f"frame {broken}: box_px differs by 3, limit 0.5"]


def test_another_number_of_rows_than_the_batch_is_a_fault() -> None:
    expected = {name: value.repeat(2, axis=0) for name, value in outputs([LEFT], [0.9]).items()}
    frames = {"a": IMAGE["frame"], "b": IMAGE["frame"]}
    one = {name: value[:1] for name, value in expected.items()}
    compared = compare_frames(lambda _: expected, lambda _: one, frames, "float32", 0.01, batch=2)
    assert [frame.fault for frame in compared] == ["boxes is missing or of another shape"] * 2


def test_a_score_under_the_stated_threshold_is_a_fault() -> None:
    both = outputs([LEFT, RIGHT], [0.9, 0.2])
    compared = compare_frames(lambda _: both, lambda _: both, IMAGE, "float32", 0.3)
    (fault,) = ParityReport("float32", compared, limits=limits_of("float32")).faults()
    assert fault == "frame: a score is 0.2, expected 0.3 or more, as the manifest says"


def test_untrained_int8_networks_are_only_checked_for_validity() -> None:
    limits = limits_of("int8", trained=False)
    expected, found = outputs([LEFT], [0.9]), outputs([RIGHT], [0.9])
    compared = compare_frames(lambda _: expected, lambda _: found, IMAGE, "int8", 0.01)
    assert ParityReport("int8", compared, limits=limits).faults() == []
    found["boxes"][0, 0, 0] = np.inf
    compared = compare_frames(lambda _: expected, lambda _: found, IMAGE, "int8", 0.01)
    (fault,) = ParityReport("int8", compared, limits=limits).faults()
    assert fault == "frame: boxes is not finite"
    assert limits_of("float32", trained=False) == limits_of("float32")
