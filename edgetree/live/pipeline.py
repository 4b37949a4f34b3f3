"""From a source to results: read, detect, measure and follow, each stage one frame ahead."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from basetree.errors import InputError
from basetree.program.interrupts import interrupt_afterwards
from calib import DepthFailure, check_depth
from edgetree.errors import ModelFileError
from edgetree.frames.depth_kind import StreamDepthKind
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import (
    FoundTrees,
    find_trees,
    has_image_for,
    measure_frame,
)
from edgetree.frames.rig import Rig
from edgetree.live.results import LiveResult, followed, numbered_stems
from edgetree.live.status import LiveStatus, StatusRecorder
from edgetree.live.tracking.picture_tracker import PictureTracker
from edgetree.live.tracking.tracker import StemTracker
from edgetree.measure import StemViews
from edgetree.runtime.detector import TreeDetector
from edgetree.sources.pushed import Handover
from edgetree.sources.source import FrameSource, SourceLost

if TYPE_CHECKING:
    from edgetree.measure import MeasureSettings

_log = logging.getLogger(__name__)

_REOPEN_S: Final = 1.0


@dataclass(frozen=True, eq=False)
class _Arrived:
    """A frame, when it arrived, and how long the source took for it."""

    frame: Frame
    at_s: float
    read_ms: float


@dataclass(frozen=True, eq=False)
class _Detected:
    """A frame with its trees."""

    arrived: _Arrived
    found: FoundTrees


class LivePipeline:
    """Reads frames, finds and measures trees, and follows them over time.

    Iterate over it for the results. Reading and detection run in threads of their own, so that
    they overlap with the measurement and with the work of the caller. Frames never queue up: each
    stage holds one. Of a camera, older frames are left out; a recording waits.

    A camera that vanishes is opened again until it comes back. A frame that cannot be used is left
    out and counted; `logging` tells of both.

    Args:
        open_source: Opens the source; called again if the source was lost.
        detector: The model.
        rig: The camera, the vertical and the mounting. Its camera takes the place of the source's
            own; its vertical is for frames without one.
        settings: Settings of the measurement; the defaults if None.
        tracker: Follows the stems; a new one if None.
        reopen_s: Time between two attempts to open a source that was lost, s.
        on_unused: Called with each frame that gets no result, and the reason, from any thread.

    Attributes:
        in_picture: Follows the stems of frames without metres; None once a frame had them, from
            when on stems are followed in metres alone.

    Raises:
        InputError: The detector is none.
    """

    def __init__(
        self,
        open_source: Callable[[], FrameSource],
        detector: TreeDetector,
        *,
        rig: Rig | None = None,
        settings: MeasureSettings | None = None,
        tracker: StemTracker | None = None,
        reopen_s: float = _REOPEN_S,
        on_unused: Callable[[Frame, str], object] | None = None,
    ) -> None:
        if not hasattr(detector, "manifest"):
            raise InputError(
                f"the detector is {detector!r:.100}: expected a TreeDetector, as"
                " TreeDetector.load opens it"
            )
        self._open_source = open_source
        self._detector = detector
        self._rig = rig or Rig()
        self._mounted = Rig(
            mounting=self._rig.mounting,
            rotation_deg=self._rig.rotation_deg,
            uncertainty=self._rig.known_uncertainty(),
            references=self._rig.references,
        )
        self._turning: str | None = None
        self._depth_kind = StreamDepthKind(self._rig)
        self._settings = settings
        self._views = StemViews()
        self._tracker = tracker or StemTracker()
        self.in_picture: PictureTracker | None = PictureTracker()
        self._reopen_s = reopen_s
        self._on_unused = on_unused
        self._stopping = threading.Event()
        self._was_begun = False
        self._source: FrameSource | None = None
        self._frames: Handover[_Arrived] = Handover()
        self._detected: Handover[_Detected] = Handover()
        self._recorder = StatusRecorder()
        self._counts_before = Counter[str]()  # of sources that were lost

    @property
    def status(self) -> LiveStatus:
        """Rates, times and counts so far."""
        source = self._source  # which the thread that reads may take away
        counts = Counter[str]() if source is None else Counter(source.counts)
        return self._recorder.status(self._frames.dropped, self._counts_before + counts)

    def stop(self) -> None:
        """End the iteration after the result in progress. May be called from any thread."""
        self._stopping.set()
        source = self._source
        if source is not None:
            source.close()
        self._frames.end()
        self._detected.end()

    def __iter__(self) -> Generator[LiveResult]:
        """Yield the result of each frame.

        Raises:
            InputError: The source cannot be opened or read, or was iterated over before.
            ModelFileError: The model fails.
        """
        if self._was_begun:
            raise InputError("this LivePipeline has ended: expected a new one to go on")
        self._was_begun = True
        if self._stopping.is_set():
            return
        source = self._source = self._open_source()
        self._frames = Handover(newest_only=source.is_live, on_replaced=self._replaced)
        threads = [
            threading.Thread(target=self._read, args=(source,), name="edgetree-read"),
            threading.Thread(target=self._detect, name="edgetree-detect"),
        ]
        try:
            with interrupt_afterwards():  # one inside would leave locks locked
                for thread in threads:
                    thread.start()
            for detected in self._detected:
                with interrupt_afterwards():
                    self._recorder.begin("measure")
                    result = self._measured(detected)
                if result is not None:
                    yield result
                self._recorder.end("measure")
        finally:
            with interrupt_afterwards():
                self.stop()
            for thread in threads:
                thread.join()
            self._recorder.is_ended = True

    def _read(self, source: FrameSource | None) -> None:
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

    def _read_until_lost(self, source: FrameSource) -> FrameSource | None:
        """Hand over the frames of a source; returns the source opened again if it was lost."""
        try:
            before_s = time.monotonic()
            for frame in source:
                now_s = time.monotonic()
                self._recorder.is_lost = False
                arrived = _Arrived(frame, now_s, (now_s - before_s) * 1000)
                if not self._frames.put(arrived):
                    return None
                before_s = time.monotonic()
            return None
        except SourceLost as error:
            _log.warning("%s; opening it again every %g s", error, self._reopen_s)
            self._source, self._counts_before = None, self._counts_before + Counter(source.counts)
            self._recorder.lose_source(str(error))
        finally:
            source.close()
        return self._opened_again()

    def _opened_again(self) -> FrameSource | None:
        """The source once it can be opened again; None if the pipeline is stopped before."""
        while not self._stopping.wait(self._reopen_s):
            try:
                self._source = self._open_source()
            except InputError as error:
                _log.debug("%s", error)
                continue
            _log.warning("%s is back", self._source.name)
            return self._source
        return None

    def _detect(self) -> None:
        """The thread that detects."""
        try:
            images = self._detector.manifest.images
            for arrived in self._frames:
                frame = arrived.frame
                if not has_image_for(self._detector, frame):
                    self._leave_out(frame, f"without {images}, which the model takes")
                    continue
                self._recorder.begin("detect")
                try:
                    found = find_trees(frame, self._detector, self._rig)
                except ModelFileError:
                    raise
                except InputError as error:
                    self._leave_out(frame, str(error))
                    continue
                finally:
                    self._recorder.end("detect")
                if not self._detected.put(_Detected(arrived, found)):
                    return
        except Exception as error:  # noqa: BLE001 raised again by the iteration
            self._detected.end(error)
        finally:
            self._detected.end()
            self._frames.end()

    def _replaced(self, arrived: _Arrived) -> None:
        if self._on_unused is not None:
            self._on_unused(arrived.frame, "a newer frame had arrived")

    def _leave_out(self, frame: Frame, reason: str) -> None:
        if self._on_unused is not None:
            self._on_unused(frame, reason)
        if self._recorder.leave_out(reason.replace(f"{frame.where}: ", "")) == 1:
            _log.warning("frame %s left out, and more if they are alike: %s", frame.number, reason)

    def _measured(self, detected: _Detected) -> LiveResult | None:
        """The result of a frame; None if it does not fit its camera."""
        arrived, found = detected.arrived, detected.found
        start_s = time.perf_counter()
        try:
            frame = self._completed(arrived.frame, found)
            frame.stamp_s  # noqa: B018 a frame without one cannot be followed
            measured = measure_frame(frame, found, self._mounted, self._settings, self._views)
        except InputError as error:
            self._leave_out(arrived.frame, str(error))
            return None
        if measured.turning is not None and self._turning is None:
            self._turning = measured.turning
            _log.warning("%s", measured.turning)
        if measured.measurements is not None and (words := self._depth_kind.words(frame)):
            _log.warning("%s", words)
        middle_s = time.perf_counter()
        if measured.measurements is not None and self.in_picture is not None:
            self._tracker.number_from(self.in_picture.count + 1)
            self.in_picture = None
        elif self.in_picture is not None:
            measured = numbered_stems(measured, self.in_picture)
        result = followed(measured, self._tracker)
        end_s = time.perf_counter()
        stages_ms = {
            "read": arrived.read_ms,
            "detect": found.detect_ms,
            "measure": (middle_s - start_s) * 1000,
            "track": (end_s - middle_s) * 1000,
        }
        age_s = time.monotonic() - arrived.at_s
        self._recorder.add(stages_ms, age_s)
        return replace(result, stages_ms=stages_ms, age_s=age_s, dropped=self._frames.dropped)

    def _completed(self, frame: Frame, found: FoundTrees) -> Frame:
        """The frame with the camera and vertical of the rig, and faults of the depth."""
        trees = found.trees
        frame = self._rig.completed(frame, trees.image_width, trees.image_height)
        if frame.up_camera is None:  # the horizon may tell it
            frame = replace(frame, up_camera=self._rig.vertical_of(frame, frame.camera))
        if frame.depth_m is None or frame.camera is None or frame.depth_fault is not None:
            return frame
        check = check_depth(frame.depth_m)
        fault = check.reason if isinstance(check, DepthFailure) else None
        return replace(frame, depth_fault=fault)
