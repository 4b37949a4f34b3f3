"""The live pipeline: what it drops, survives, counts, and how it ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from basetree.errors import InputError
from calib import PinholeCamera
from edgetree.errors import ModelFileError
from edgetree.frames.frame import Frame, stream_frame
from edgetree.frames.references import SizeReferences
from edgetree.frames.rig import Rig
from edgetree.live.pipeline import LivePipeline
from edgetree.live.tracking.tracker import StemTracker
from edgetree.measure import RigUncertainty
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import Arrays, FakeSession
from edgetree.sources.playing import PacedSource
from edgetree.sources.source import SourceLost

CAMERA = PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)
KNOWN_RIG = Rig(uncertainty=RigUncertainty(0.01, 1.0, 1.0))  # of which nothing has to be told
PATIENCE_S = 60.0


class Source:
    """A source that yields given frames; an exception among them is raised."""

    def __init__(
        self, items: Iterable[Any], *, is_live: bool = False, every_s: float = 0.0
    ) -> None:
        self.name = "test source"
        self.is_live = is_live
        self.counts: dict[str, int] = {}
        self.closed = threading.Event()
        self._items = items
        self._every_s = every_s

    def __iter__(self) -> Iterator[Frame]:
        for item in self._items:
            if self.closed.wait(self._every_s):
                return
            if isinstance(item, Exception):
                raise item
            yield item

    def close(self) -> None:
        self.closed.set()


class _Vanishing(LivePipeline):
    """A pipeline whose source is taken away between two looks at it."""

    looks = 0

    @property
    def _source(self) -> Source | None:
        self.looks += 1
        return Source([]) if self.looks % 2 else None

    @_source.setter
    def _source(self, source: object) -> None:
        pass


def colour(number: int, **changes: Any) -> Frame:
    depth_m = np.tile(np.linspace(3.9, 4.1, 640, dtype=np.float32), (360, 1))
    values = {"image": np.zeros((360, 640, 3), np.uint8), "depth_m": depth_m, "camera": CAMERA}
    return stream_frame(number=number, time_s=number / 10, **(values | changes))


@pytest.fixture
def detector(rgb_manifest: Manifest, two_trees: dict[str, Any]) -> TreeDetector:
    return TreeDetector(FakeSession.with_trees(rgb_manifest, **two_trees))


def calling(detector: TreeDetector, function: Callable[[Arrays], object]) -> TreeDetector:
    """A detector that calls a function before each detection."""
    found = detector.session.run

    def run(inputs: Arrays) -> Arrays:
        function(inputs)
        return found(inputs)

    return TreeDetector(FakeSession(detector.manifest, run))


def opening(*sources: Any) -> Callable[[], Any]:
    """A function that opens one source after the other; an exception is raised."""
    left = list(sources)

    def opened() -> Any:
        source = left.pop(0)
        if isinstance(source, Exception):
            raise source
        return source

    return opened


def test_a_recording_gives_every_frame_in_order(detector: TreeDetector) -> None:
    source = Source([colour(number) for number in range(20)])
    late = calling(detector, lambda _: time.sleep(0.01))
    results = list(LivePipeline(opening(source), late))
    assert [result.frame.number for result in results] == list(range(20))
    assert all(len(result.trees) == 1 for result in results)
    assert all(result.measurements[0].distance_m for result in results)
    assert set(results[-1].stages_ms) == {"read", "detect", "measure", "track"}
    assert results[-1].stages_ms["detect"] >= 10
    assert source.closed.is_set()


def test_a_camera_gives_its_newest_frame_and_counts_the_dropped(detector: TreeDetector) -> None:
    all_read, source_read = threading.Event(), []

    def read() -> Iterator[Frame]:
        for number in range(20):
            source_read.append(number)
            yield colour(number)
        all_read.set()

    def wait_for_all(_: Arrays) -> None:
        assert all_read.wait(PATIENCE_S)

    pipeline = LivePipeline(opening(Source(read(), is_live=True)), calling(detector, wait_for_all))
    numbers = [result.frame.number for result in pipeline]
    # The frame in detection and the newest one. The first may be replaced before it is detected.
    assert numbers[-1] == 19
    assert len(numbers) <= 2
    assert pipeline.status.dropped == 20 - len(numbers)
    assert len(source_read) == 20


def test_each_frame_without_a_result_is_told_with_the_reason(detector: TreeDetector) -> None:
    told: dict[int, str] = {}
    all_read = threading.Event()

    def read() -> Iterator[Frame]:
        for number in range(9):
            yield colour(number)
        yield colour(9, image=None)
        all_read.set()
        yield colour(10)

    pipeline = LivePipeline(
        opening(Source(read(), is_live=True, every_s=0.005)),
        calling(detector, lambda _: all_read.wait(PATIENCE_S)),
        on_unused=lambda frame, reason: told.update({frame.number: reason}),
    )
    with_result = [result.frame.number for result in pipeline]
    assert sorted([*told, *with_result]) == list(range(11))
    assert set(told.values()) <= {
        "a newer frame had arrived",
        "without colour, which the model takes",
    }


def test_detection_goes_on_while_the_caller_works(detector: TreeDetector) -> None:
    begun = threading.Semaphore(0)
    results = iter(
        LivePipeline(
            opening(Source(map(colour, range(10)))), calling(detector, lambda _: begun.release())
        )
    )
    next(results)
    for _ in range(2):  # of the first frame, and of the next one while the caller has the first
        assert begun.acquire(timeout=PATIENCE_S)
    results.close()


def test_a_lost_camera_is_opened_again(
    detector: TreeDetector, caplog: pytest.LogCaptureFixture
) -> None:
    lost = SourceLost("camera 0 does not answer")
    first = Source([colour(0), colour(1), lost], is_live=True, every_s=0.05)
    second = Source([colour(2), colour(3)], is_live=True, every_s=0.05)
    open_source = opening(first, InputError("no camera 0"), InputError("no camera 0"), second)
    pipeline = LivePipeline(open_source, detector, rig=KNOWN_RIG, reopen_s=0.02)
    assert [result.frame.number for result in pipeline] == [0, 1, 2, 3]
    assert pipeline.status.lost == 1
    assert first.closed.is_set()
    assert caplog.messages == [
        "camera 0 does not answer; opening it again every 0.02 s",
        "test source is back",
    ]


def test_the_state_says_that_the_source_is_lost(detector: TreeDetector) -> None:
    source = Source([colour(0), SourceLost("gone")], is_live=True)
    missing = [InputError("no camera")] * 1000
    pipeline = LivePipeline(opening(source, *missing), detector, reopen_s=0.02)
    results = iter(pipeline)
    next(results)
    waiting = threading.Thread(target=lambda: list(results))
    waiting.start()
    deadline = time.monotonic() + PATIENCE_S
    while pipeline.status.state != "lost" and time.monotonic() < deadline:
        time.sleep(0.01)
    assert pipeline.status.state == "lost"
    assert "source lost 1 time" in pipeline.status.line()
    pipeline.stop()
    waiting.join(PATIENCE_S)
    assert not waiting.is_alive()


def test_stopping_ends_all(detector: TreeDetector) -> None:
    source = Source(map(colour, range(10_000)), every_s=0.001)
    pipeline = LivePipeline(opening(source), detector)
    threads = threading.active_count()
    results = iter(pipeline)
    next(results)
    pipeline.stop()
    assert len(list(results)) <= 1
    assert source.closed.is_set()
    assert threading.active_count() == threads
    assert pipeline.status.state == "ended"


def test_leaving_the_loop_ends_the_threads(detector: TreeDetector) -> None:
    source = Source(map(colour, range(10_000)))
    threads = threading.active_count()
    results = iter(LivePipeline(opening(source), detector))
    next(results)
    results.close()
    assert threading.active_count() == threads
    assert source.closed.is_set()


def test_frames_that_do_not_fit_are_counted(
    detector: TreeDetector, caplog: pytest.LogCaptureFixture
) -> None:
    frames = [colour(0), colour(1, image=None), colour(2), colour(3, image=None), colour(4)]
    pipeline = LivePipeline(opening(Source(frames)), detector, rig=KNOWN_RIG)
    assert [result.frame.number for result in pipeline] == [0, 2, 4]
    assert pipeline.status.left_out == {"without colour, which the model takes": 2}
    assert len(caplog.messages) == 1


def test_what_the_source_left_out_is_in_the_status(detector: TreeDetector) -> None:
    source = Source([colour(0)])
    source.counts["colour without depth"] = 3
    pipeline = LivePipeline(opening(source), detector)
    list(pipeline)
    assert pipeline.status.left_out == {"colour without depth": 3}
    assert "3 left out: colour without depth" in pipeline.status.line()


def test_remarks_on_used_frames_are_told_apart(detector: TreeDetector) -> None:
    source = Source([colour(0)])
    source.counts["without pose"] = 1
    pipeline = LivePipeline(opening(source), detector)
    list(pipeline)
    assert pipeline.status.left_out == {}
    assert pipeline.status.remarks == {"without pose": 1}
    assert ", 1 without pose" in pipeline.status.line()
    assert "left out" not in pipeline.status.line()


def test_counts_of_a_lost_source_are_kept(detector: TreeDetector) -> None:
    first, second = Source([colour(0), SourceLost("gone")]), Source([colour(1)])
    first.counts["colour without depth"], second.counts["colour without depth"] = 500, 1
    pipeline = LivePipeline(opening(first, second), detector, reopen_s=0.01)
    list(pipeline)
    assert pipeline.status.left_out == {"colour without depth": 501}


def test_camera_and_vertical_of_the_rig_reach_tracker_and_results(detector: TreeDetector) -> None:
    up = np.array([0.0, -np.cos(np.radians(25)), -np.sin(np.radians(25))])
    tracker = StemTracker()
    pipeline = LivePipeline(
        opening(Source([colour(0, camera=None)])),
        detector,
        rig=Rig(camera=CAMERA, up_camera=tuple(up)),
        tracker=tracker,
    )
    (result,) = pipeline
    assert result.frame.camera == CAMERA
    assert result.frame.up_camera == pytest.approx(up)
    assert tracker.camera_pose.rotation[2] == pytest.approx(up)


MISSING = {
    "depth": (
        {"depth_m": None},
        "need depth with each frame; or without depth --camera-height or --marker",
    ),
    "camera": ({"camera": None}, "need the camera: pass --camera"),
}


@pytest.mark.parametrize("what", MISSING)
def test_metres_need_depth_and_a_camera(detector: TreeDetector, what: str) -> None:
    changes, reason = MISSING[what]
    (result,) = LivePipeline(opening(Source([colour(0, **changes)])), detector)
    assert result.metres_need == reason
    assert result.measurements is None
    assert len(result.trees) == 1


def test_the_vertical_by_a_horizon_reaches_the_tracker(detector: TreeDetector) -> None:
    """Where the camera looks down by 20 degrees."""
    tilt = np.radians(20)
    row_px = CAMERA.cy + 0.5 - CAMERA.fy * np.tan(tilt)
    tracker = StemTracker()
    rig = replace(KNOWN_RIG, references=SizeReferences(horizon_px=(0.0, row_px, 640.0, row_px)))
    frames = [colour(number) for number in range(2)]
    results = list(LivePipeline(opening(Source(frames)), detector, rig=rig, tracker=tracker))
    up = [0.0, -np.cos(tilt), -np.sin(tilt)]
    assert [result.frame.up_camera for result in results] == [pytest.approx(up)] * 2
    assert tracker.up_camera == pytest.approx(up)


def test_stems_with_metres_take_no_number_of_one_followed_in_the_picture(
    detector: TreeDetector,
) -> None:
    """The depth camera starts later."""
    frames = [colour(number, **({"depth_m": None} if number < 5 else {})) for number in range(10)]
    results = list(LivePipeline(opening(Source(frames)), detector))
    in_picture = {number for result in results[:5] for number in result.found.tracks or ()}
    with_metres = {track.number for result in results[5:] for track in result.tracks}
    assert in_picture == {None, 1}
    assert with_metres == {2}


def test_depth_in_millimetres_is_a_reason_not_metres(detector: TreeDetector) -> None:
    depth = np.tile(np.linspace(3900, 4100, 640, dtype=np.float32), (360, 1))
    (result,) = LivePipeline(opening(Source([colour(0, depth_m=depth)])), detector)
    assert "look like millimetres" in result.measurements[0].diameter_m.reason


ENDS = {
    "the source cannot be opened": (opening(InputError("no such bag")), InputError, "no such bag"),
    "the source cannot be read": (
        opening(Source([colour(0), InputError("cut off")])),
        InputError,
        "cut off",
    ),
}


@pytest.mark.parametrize("case", ENDS)
def test_errors_of_the_source_reach_the_caller(detector: TreeDetector, case: str) -> None:
    open_source, kind, message = ENDS[case]
    threads = threading.active_count()
    with pytest.raises(kind, match=message):
        list(LivePipeline(open_source, detector))
    assert threading.active_count() == threads


def test_errors_of_the_model_reach_the_caller(rgb_manifest: Manifest) -> None:
    def fail(_: Arrays) -> Arrays:
        raise ModelFileError("model x failed")

    detector = TreeDetector(FakeSession(rgb_manifest, fail))
    source = Source(map(colour, range(10_000)))
    with pytest.raises(ModelFileError, match="model x failed"):
        list(LivePipeline(opening(source), detector))
    assert source.closed.is_set()


def test_a_tracker_may_be_given(detector: TreeDetector) -> None:
    class Counting(StemTracker):
        frames = 0

        def update(self, *arguments: Any) -> list[Any]:
            self.frames += 1
            return []

    tracker = Counting()
    list(LivePipeline(opening(Source([colour(0), colour(1)])), detector, tracker=tracker))
    assert tracker.frames == 2


def test_a_recording_plays_no_faster_than_it_was_made() -> None:
    source = PacedSource(Source([colour(number) for number in (0, 1, 2, 4)]))
    start = time.monotonic()
    arrived = [time.monotonic() - start for _ in source]
    assert source.is_live
    assert all(at >= due - 0.001 for at, due in zip(arrived, (0, 0.1, 0.2, 0.4), strict=True)), (
        arrived
    )


def test_a_jump_of_the_clock_does_not_stop_the_recording() -> None:
    frames = [colour(0), stream_frame(1, 1e9, None), stream_frame(2, 0.2, None)]
    assert len(list(PacedSource(Source(frames)))) == 3


def test_closing_ends_a_wait() -> None:
    source = PacedSource(Source([stream_frame(0, 0.0, None), stream_frame(1, 4.0, None)]))
    frames = iter(source)
    next(frames)
    threading.Timer(0.1, source.close).start()
    assert next(frames, None) is None


def test_a_source_that_is_lost_meanwhile_is_no_fault_of_who_asks(detector: TreeDetector) -> None:
    pipeline = _Vanishing(lambda: Source([]), detector)
    assert pipeline.status.state == "starting"
    pipeline.looks = 0
    pipeline.stop()


def test_a_detector_that_is_a_name_is_refused() -> None:
    with pytest.raises(InputError, match="the detector is 'edge-n-depth': expected a TreeDetector"):
        LivePipeline(opening(Source([])), "edge-n-depth")


def test_a_frame_without_a_time_is_left_out_and_a_pipeline_runs_once(
    detector: TreeDetector,
) -> None:
    frames = [colour(0), replace(colour(1), time_s=None), colour(2)]
    pipeline = LivePipeline(opening(Source(frames)), detector)
    assert [result.frame.number for result in pipeline] == [0, 2]
    assert sum(pipeline.status.left_out.values()) == 1
    with pytest.raises(InputError, match="has ended: expected a new one"):
        next(iter(pipeline))
