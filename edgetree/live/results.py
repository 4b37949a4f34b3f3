"""The result of one frame with the stems that are followed, and maps of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from basetree.errors import InputError
from edgetree.frames.pipeline import FrameResult
from edgetree.live.tracking.tracker import StemTracker
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import TreeMeasurement
from edgetree.sinks.maps import open_map
from edgetree.sinks.sink import FileSink

_MOST_WITHOUT_POSE_S: Final = 2.0  # at the beginning of a recording


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveResult(FrameResult):
    """The result of a frame, and the stems that are followed.

    Attributes:
        tracks: The stems that are followed, seen in this frame or not.
        stages_ms: Time that each stage took for this frame, such as {"detect": 31.0}.
        age_s: Time from the arrival of the frame to this result, s.
        dropped: Frames that were left out so far because newer ones had arrived.
    """

    tracks: list[TreeTrack]
    stages_ms: dict[str, float] = field(default_factory=dict)
    age_s: float = 0.0
    dropped: int = 0


def followed(result: FrameResult, tracker: StemTracker) -> LiveResult:
    """Follow the stems into one more frame.

    Args:
        result: The result of the frame, which has a time stamp.
        tracker: Follows the stems.

    Raises:
        InputError: The frame has no time stamp.
    """
    measurements = result.measurements
    if measurements is None:
        measurements = [TreeMeasurement.failed(result.metres_need or "")] * len(result.trees)
    tracks = tracker.update(result.frame, result.trees, measurements)
    return LiveResult(**vars(result), tracks=tracks)


class PosedMapSink(FileSink[FrameResult]):
    """Follows the stems through frames with poses, and writes a map of them when it is closed.

    Frames before the first pose are left out.

    Args:
        path: The file to write, .geojson or .gpkg.

    Raises:
        InputError: The file cannot be written; when results are written or the sink is closed, if
            there are no poses.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._map = self._files.enter_context(open_map(path))
        self._files.enter_context(self._with_poses())
        self._tracker = StemTracker()
        self._first: FrameResult | None = None
        self._has_poses = False

    @contextmanager
    def _with_poses(self) -> Iterator[None]:
        yield
        self._check_poses()

    def write(self, result: FrameResult) -> None:
        """Take the result of one frame."""
        self._first = self._first or result
        self._has_poses = self._has_poses or result.frame.pose is not None
        if self._has_poses:
            self._map.write(followed(result, self._tracker))
        elif result.frame.stamp_s - self._first.frame.stamp_s > _MOST_WITHOUT_POSE_S:
            self._check_poses()

    def _check_poses(self) -> None:
        if self._first is not None and not self._has_poses:
            raise InputError(
                f"frame {self._first.frame.name} and those after it have no pose: expected a source"
                " with poses for a map; `edgetree live` follows stems without them"
            )
