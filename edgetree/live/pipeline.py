"""From a source to results: read, detect, measure and follow, each stage one frame ahead."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import DepthFailure, check_depth
from edgetree.detections import TreeDetections
from edgetree.errors import ModelFileError
from edgetree.frames.rig import Rig
from edgetree.live.completion import completed
from edgetree.live.frames import LiveFrame, LiveSource, SourceLost
from edgetree.live.handover import Handover
from edgetree.live.results import LiveResult
from edgetree.live.status import LiveStatus, StatusRecorder
from edgetree.live.tracking.tracker import StemTracker
from edgetree.measure import TreeMeasurement, measure_trees
from edgetree.runtime.detector import TreeDetector

if TYPE_CHECKING:
    from edgetree.measure import MeasureSettings

__all__ = ["LivePipeline"]

_log = logging.getLogger(__name__)

_REOPEN_S: Final = 1.0
_NO_DEPTH: Final = "need depth with each frame"
_NO_CAMERA: Final = "need the camera: pass --camera"


@dataclass(frozen=True, eq=False)
class _Arrived:
    """A frame, when it arrived, and how long the source took for it."""

    frame: LiveFrame
    at_s: float
    read_ms: float


@dataclass(frozen=True, eq=False)
class _Detected:
    """A frame with its trees."""

    arrived: _Arrived
    trees: TreeDetections
    detect_ms: float


class LivePipeline:
    """Reads frames, finds and measures trees, and follows them over time.

    Iterate over it for the results. Reading and detection run in threads of their own, so that
    they overlap with the measurement and with the work of the caller. Frames never queue up: each
    stage holds one. Of a camera, older frames are left out; a recording waits.

    A camera that vanishes is opened again until it comes back. A frame that cannot be used is left
    out and counted; `logging` tells of both.

    Args:
        open_source: opens the source; called again if the source was lost.
        detector: the model.
        rig: the camera, the vertical and the mounting, for sources that do not know them.
        settings: settings of the measurement; the defaults if None.
        tracker: follows the stems; a new one if None.
        reopen_s: time between two attempts to open a source that was lost, s.
    """

    def __init__(
        self,
        open_source: Callable[[], LiveSource],
        detector: TreeDetector,
        *,
        rig: Rig | None = None,
        settings: MeasureSettings | None = None,
        tracker: StemTracker | None = None,
        reopen_s: float = _REOPEN_S,
    ) -> None:
        self._open_source = open_source
        self._detector = detector
        self._rig = rig or Rig()
        self._settings = settings
        self._tracker = tracker or StemTracker()
        self._reopen_s = reopen_s
        self._stopping = threading.Event()
        self._source: LiveSource | None = None
        self._frames: Handover[_Arrived] = Handover()
        self._detected: Handover[_Detected] = Handover()
        self._recorder = StatusRecorder()
        self._counts_before = Counter[str]()  # of sources that were lost

    @property
    def status(self) -> LiveStatus:
        """Rates, times and counts so far."""
        counts = Counter[str]() if self._source is None else Counter(self._source.counts)
        return self._recorder.status(self._frames.dropped, self._counts_before + counts)

    def stop(self) -> None:
        """End the iteration after the result in progress. May be called from any thread."""
        self._stopping.set()
        if self._source is not None:
            self._source.close()
        self._frames.end()
        self._detected.end()

    def __iter__(self) -> Generator[LiveResult]:
        """Yield the result of each frame.

        Raises:
            InputError: the source cannot be opened or read.
            ModelFileError: the model fails.
        """
        source = self._source = self._open_source()
        self._frames = Handover(newest_only=source.is_live)
        threads = [
            threading.Thread(target=self._read, args=(source,), name="edgetree-read"),
            threading.Thread(target=self._detect, name="edgetree-detect"),
        ]
        for thread in threads:
            thread.start()
        try:
            for detected in self._detected:
                result = self._measured(detected)
                if result is not None:
                    yield result
        finally:
            self.stop()
            for thread in threads:
                thread.join()
            self._recorder.is_ended = True

    def _read(self, source: LiveSource | None) -> None:
        """The thread that reads."""
        try:
            while source is not None and not self._stopping.is_set():
                source = self._read_until_lost(source)
        except Exception as error:  # noqa: BLE001 raised again by the iteration
            self._frames.end(error)
        finally:
            self._frames.end()
            if source is not None:
                source.close()

    def _read_until_lost(self, source: LiveSource) -> LiveSource | None:
        """Hand over the frames of a source; returns the source opened again if it was lost."""
        try:
            before_s = time.monotonic()
            for frame in source:
                now_s = time.monotonic()
                arrived = _Arrived(frame, now_s, (now_s - before_s) * 1000)
                if not self._frames.put(arrived):
                    return None
                before_s = time.monotonic()
            return None
        except SourceLost as error:
            _log.warning("%s; opening it again every %g s", error, self._reopen_s)
            self._source, self._counts_before = None, self._counts_before + Counter(source.counts)
            self._recorder.lose_source()
        finally:
            source.close()
        return self._opened_again()

    def _opened_again(self) -> LiveSource | None:
        """The source once it can be opened again; None if the pipeline is stopped before."""
        while not self._stopping.wait(self._reopen_s):
            try:
                self._source = self._open_source()
            except InputError as error:
                _log.debug("%s", error)
                continue
            self._recorder.is_lost = False
            _log.warning("%s is back", self._source.name)
            return self._source
        return None

    def _detect(self) -> None:
        """The thread that detects."""
        try:
            for arrived in self._frames:
                image = self._image(arrived.frame)
                if image is None:
                    continue
                before_s = time.perf_counter()
                try:
                    trees = self._detector.detect(image)
                except ModelFileError:
                    raise
                except InputError as error:
                    self._leave_out(arrived.frame, str(error))
                    continue
                detect_ms = (time.perf_counter() - before_s) * 1000
                if not self._detected.put(_Detected(arrived, trees, detect_ms)):
                    return
        except Exception as error:  # noqa: BLE001 raised again by the iteration
            self._detected.end(error)
        finally:
            self._detected.end()
            self._frames.end()

    def _image(self, frame: LiveFrame) -> NDArray[Any] | None:
        """The image that the model takes; None if the frame has none."""
        takes_depth = self._detector.manifest.takes_depth
        image = frame.depth_m if takes_depth else frame.image
        if image is None:
            kind = "depth" if takes_depth else "colour"
            self._leave_out(frame, f"without {kind}, which the model takes")
        return image

    def _leave_out(self, frame: LiveFrame, reason: str) -> None:
        if self._recorder.leave_out(reason) == 1:
            _log.warning("frame %d left out, and more if they are alike: %s", frame.number, reason)

    def _measured(self, detected: _Detected) -> LiveResult | None:
        """The result of a frame; None if it does not fit its camera."""
        arrived, trees = detected.arrived, detected.trees
        frame = arrived.frame
        start_s = time.perf_counter()
        try:
            frame = completed(frame, self._rig, trees.image_width, trees.image_height)
            measurements, missing = self._measure(frame, trees)
        except InputError as error:
            self._leave_out(frame, str(error))
            return None
        middle_s = time.perf_counter()
        failed = [TreeMeasurement.failed(missing)] * len(trees) if missing else []
        tracks = self._tracker.update(frame, trees, measurements or failed)
        end_s = time.perf_counter()
        stages_ms = {
            "read": arrived.read_ms,
            "detect": detected.detect_ms,
            "measure": (middle_s - start_s) * 1000,
            "track": (end_s - middle_s) * 1000,
        }
        age_s = time.monotonic() - arrived.at_s
        self._recorder.add(stages_ms, age_s)
        return LiveResult(
            frame=frame,
            trees=trees,
            measurements=measurements,
            metres_need=missing,
            tracks=tracks,
            stages_ms=stages_ms,
            age_s=age_s,
            dropped=self._frames.dropped,
        )

    def _measure(
        self, frame: LiveFrame, trees: TreeDetections
    ) -> tuple[list[TreeMeasurement] | None, str | None]:
        """The measurements, or None and what is missing for them."""
        if frame.depth_m is None or frame.camera is None:
            return None, _NO_CAMERA if frame.depth_m is not None else _NO_DEPTH
        fault = frame.depth_fault or _fault(frame.depth_m)
        if fault is not None:
            return [TreeMeasurement.failed(fault) for _ in range(len(trees))], None
        measurements = measure_trees(
            trees,
            frame.depth_m,
            frame.camera,
            up_camera=frame.up_camera,
            mounting=self._rig.mounting,
            settings=self._settings,
        )
        return measurements, None


def _fault(depth_m: NDArray[np.float32]) -> str | None:
    """Why depth is unusable; None if it is usable."""
    check = check_depth(depth_m)
    return check.reason if isinstance(check, DepthFailure) else None
