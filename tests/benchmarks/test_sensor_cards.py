"""What networks find through many depth cameras."""

import numpy as np
import pytest

from benchmarks.sensor_cards import Score, add_capture, add_frame, edge_errors
from benchmarks.sensor_views import VIEWS, SensorView, exact, no_ground
from calib import PinholeCamera, write_depth
from edgetree import TreeDetections
from perceptree.data import FrameRecord
from perceptree.data.coco import TreeRecord

WIDTH_PX, HEIGHT_PX = 320, 180
CAMERA = PinholeCamera(WIDTH_PX, HEIGHT_PX, 200, 200, 159.5, 89.5)
WALL_M, POST_M = 12.0, 4.0


class Known:
    """A detector that finds one post, `outward_px` too wide on each side, of a fixed picture."""

    def __init__(self, mask: np.ndarray, outward_px: int) -> None:
        rows, columns = np.nonzero(mask)
        self.box = (
            columns.min() - outward_px,
            rows.min(),
            columns.max() + 1 + outward_px,
            rows.max() + 1,
        )

    def detect(self, depth_m: np.ndarray) -> TreeDetections:
        return TreeDetections(
            np.array([self.box], np.float32),
            np.ones(1, np.float32),
            np.zeros((1, 5, 3), np.float32),
            np.ones((1, 28, 28), np.float32),
            depth_m.shape[1],
            depth_m.shape[0],
        )


def post(left: int = 150, right: int = 180) -> tuple[np.ndarray, np.ndarray]:
    depth_m = np.full((HEIGHT_PX, WIDTH_PX), WALL_M, np.float32)
    mask = np.zeros(depth_m.shape, bool)
    mask[20:160, left:right] = True
    depth_m[mask] = POST_M
    return depth_m, mask


@pytest.fixture
def frame(tmp_path_factory: pytest.TempPathFactory) -> FrameRecord:
    folder = tmp_path_factory.mktemp("exact")
    depth_m, _ = post()
    write_depth(folder / "exact.png", depth_m)
    polygon = [[150.0, 20, 180, 20, 180, 160, 150, 160]]
    box = np.array([150.0, 20, 180, 160])
    tree = TreeRecord(1, box, np.zeros((5, 3)), polygon, False, {"distance_m": POST_M})
    extra = {"camera": CAMERA.to_dict()}
    none = folder / "none.png"
    return FrameRecord(
        *(1, none, None, None, WIDTH_PX, HEIGHT_PX, extra, (tree,), folder / "exact.png", 1)
    )


@pytest.mark.parametrize("outward_px", [0, 2])
def test_edges_outside_of_the_label_count_as_outward(frame: FrameRecord, outward_px: int) -> None:
    score, view = Score(), SensorView("whole", WIDTH_PX, HEIGHT_PX, exact)
    _, mask = post()
    add_frame(score, Known(mask, outward_px), view, frame, 0)
    assert score.to_dict() == {
        "trees": 1,
        "found": 1.0,
        "right": 1.0,
        "outward_px": outward_px,
        "std_px": 0.0,
    }


def test_a_tree_without_readings_does_not_count(frame: FrameRecord) -> None:
    score = Score()
    nothing = SensorView("blind", WIDTH_PX, HEIGHT_PX, lambda rng, depth_m, camera: depth_m * 0)
    add_frame(score, Known(post()[1], 0), nothing, frame, 0)
    assert (score.trees, score.shown) == (0, 0)


def test_a_detection_beside_the_tree_is_wrong(frame: FrameRecord) -> None:
    score, view = Score(), SensorView("whole", WIDTH_PX, HEIGHT_PX, exact)
    beside = np.roll(post()[1], 14, 1)
    add_frame(score, Known(beside, 0), view, frame, 0)
    assert (score.trees, score.found, score.shown, score.right) == (1, 0, 1, 0)


def test_rows_of_several_runs_and_at_the_border_are_left_out() -> None:
    _, mask = post()
    split = mask.copy()
    split[:, 160:165] = False
    assert len(edge_errors(mask, split)) == 0
    cut = np.zeros_like(mask)
    cut[20:160, :30] = True
    assert len(edge_errors(cut, cut)) == 0
    assert edge_errors(mask, np.roll(mask, 1, 1)).tolist() == [1.0, -1.0] * 140


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: f"{view.name} {view.width}x{view.height}")
def test_picture_mask_and_camera_of_a_view_agree(view: SensorView) -> None:
    depth_m, mask = post()
    picture, outline = view.depth_of(depth_m), view.mask_of(mask)
    assert picture.shape == outline.shape == (view.height, view.width)
    assert (outline != (picture == POST_M)).mean() < 0.03
    camera = view.camera_of(CAMERA)
    x0, y0, x1, _ = view.window(WIDTH_PX, HEIGHT_PX)
    assert camera.fx == pytest.approx(200 * view.width / (x1 - x0))
    # The optical axis stays where it was in the frame.
    scale = view.width / (x1 - x0)
    assert ((camera.cx + 0.5) / scale + x0, (camera.cy + 0.5) / scale + y0) == (160, 90)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: f"{view.name} {view.width}x{view.height}")
def test_a_view_reads_the_post_and_repeats_itself(view: SensorView) -> None:
    depth_m, mask = post()
    camera, inner = view.camera_of(CAMERA), view.mask_of(mask)
    first, again = (
        view.sensor(np.random.default_rng(3), view.depth_of(depth_m), camera) for _ in range(2)
    )
    assert (first == again).all()
    read = first[inner & (first > 0)]
    assert len(read) > 0.05 * inner.sum()
    assert np.median(read) == pytest.approx(POST_M, abs=0.3)


def test_the_ground_is_removed_and_the_post_stays() -> None:
    rows = np.arange(HEIGHT_PX, dtype=np.float32)[:, None] - CAMERA.cy
    ground = np.where(rows > 20, 1.5 * CAMERA.fy / np.maximum(rows, 1), 0).astype(np.float32)
    depth_m = np.tile(ground, (1, WIDTH_PX))
    depth_m[20:150, 150:180] = POST_M
    found = no_ground(np.random.default_rng(0), depth_m, CAMERA)
    assert (found[20:150, 150:180] > 0).mean() > 0.9
    assert (found > 0).sum() < 1.1 * 130 * 30


def test_the_stem_of_a_capture_is_its_largest_part() -> None:
    depth_m, mask = post()
    depth_m[~mask] = 0
    depth_m[:10, :10] = 2.0
    depth_m[0:20, 150:180] = POST_M
    for outward_px, found in ((1, 1), (60, 0)):
        score = Score()
        add_capture(score, Known(mask, outward_px), depth_m)
        assert (score.trees, score.found) == (1, found)
