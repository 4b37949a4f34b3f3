"""Live results: made-up ones of any number of stems, and those of the sample frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from calib import PinholeCamera, RigidTransform
from edgetree.detections import TreeDetections
from edgetree.frames.frame import stream_frame
from edgetree.frames.pipeline import FoundTrees
from edgetree.live.results import LiveResult
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import Estimate, Failure, PointEstimate, TreeMeasurement, measure_trees
from edgetree.runtime import TreeDetector, default_model
from edgetree.samples import SampleFrame, sample_frames

MakeResult = Callable[..., LiveResult]
WIDTH, HEIGHT = 640, 360
CAMERA = PinholeCamera(WIDTH, HEIGHT, 400.0, 400.0, 319.5, 179.5)


def make_track(number: int, tree: int | None, **changes: object) -> TreeTrack:
    """A stem with plausible values. Stem `number` stands 2 + number metres ahead."""
    place = np.array([0.5 * number - 1.0, 1.6, 2.0 + number])
    track = TreeTrack(
        number=number,
        tree=tree,
        state="confirmed",
        position_m=PointEstimate(np.array([place[0], place[2], 0.1]), np.array([0.03, 0.05, 0.02])),
        position_camera_m=place,
        diameter_m=Estimate(0.2 + 0.011 * number, 0.006),
        dbh_m=Estimate(0.18 + 0.011 * number, 0.007),
        cut_height_m=Estimate(0.12, 0.02),
        inclination_deg=Estimate(2.5, 0.8),
        frames=20,
        views=5,
        arc_deg=34.0,
        more_views_help=False,
        last_seen_s=0.0,
    )
    return dataclasses.replace(track, **changes)  # type: ignore[arg-type]


def make_measurement(number: int) -> TreeMeasurement:
    """A measurement of which the diameter and the place of the cut are known."""
    point = PointEstimate(np.array([0.5 * number - 1.0, 1.6, 2.0 + number]), np.full(3, 0.02))
    failed = TreeMeasurement.failed("made up")
    return dataclasses.replace(
        failed, diameter_m=Estimate(0.2 + 0.011 * number, 0.006), cut_point_m=point
    )


@pytest.fixture
def live_result() -> MakeResult:
    """A function that makes a result of stems 1, 2, ...; the last one is out of view."""

    def make(
        number: int = 0,
        stems: int = 3,
        *,
        time_s: float | None = None,
        age_s: float = 0.05,
        measured: bool = True,
        image: np.ndarray | None = None,
        pose: RigidTransform | None = None,
        **track_changes: object,
    ) -> LiveResult:
        time_s = number / 10 if time_s is None else time_s
        seen = max(stems - 1, 0)
        x = np.linspace(40, WIDTH - 80, seen)
        boxes = np.stack([x, np.full(seen, 20), x + 30, np.full(seen, 330)], 1).reshape(seen, 4)
        if image is None:
            image = np.full((HEIGHT, WIDTH, 3), 90 + number % 100, np.uint8)
        frame = stream_frame(number, time_s, image, None, CAMERA, np.array([0.0, -1.0, 0.0]), pose)
        measurements = [make_measurement(i + 1) for i in range(seen)]
        tracks = [
            make_track(i + 1, i if i < seen else None, **{"last_seen_s": time_s, **track_changes})
            for i in range(stems)
        ]
        return LiveResult(
            frame=frame,
            found=FoundTrees.detected(
                TreeDetections(boxes, np.full(seen, 0.9), None, None, WIDTH, HEIGHT)
            ),
            camera=CAMERA,
            measurements=measurements if measured else None,
            metres_need=None if measured else "no depth",
            tracks=tracks if measured else [],
            stages_ms={"detect": 31.0, "measure": 6.5},
            age_s=age_s,
            dropped=2,
        )

    return make


@pytest.fixture(scope="session")
def sample_results() -> list[LiveResult]:
    """The results of the sample frames by the embedded depth model, one track for each stem."""
    detector = TreeDetector.load(default_model("depth"))
    return [sample_result(detector, sample, n) for n, sample in enumerate(sample_frames())]


def sample_result(detector: TreeDetector, sample: SampleFrame, number: int) -> LiveResult:
    """Detect and measure the trees of one sample frame."""
    depth_m = sample.depth_m()
    trees = detector.detect(depth_m)
    measured = measure_trees(trees, depth_m, sample.camera, up_camera=sample.up_camera)
    frame = stream_frame(
        number, number / 10, sample.image(), depth_m, sample.camera, sample.up_camera
    )
    tracks = [
        make_track(
            100 * number + index + 1,
            index,
            position_camera_m=tree.cut_point_m.xyz_m,
            position_m=tree.cut_point_m,
            diameter_m=tree.diameter_m,
            dbh_m=tree.dbh_m,
            cut_height_m=tree.cut_height_m,
            inclination_deg=tree.inclination_deg,
            warnings=tree.evidence.warnings,
            views=1,
            frames=1,
            more_views_help=True,
            last_seen_s=number / 10,
        )
        for index, tree in enumerate(measured)
        if not isinstance(tree.cut_point_m, Failure)
    ]
    return LiveResult(
        frame=frame,
        found=FoundTrees.detected(trees),
        measurements=measured,
        metres_need=None,
        camera=sample.camera,
        tracks=tracks,
    )
