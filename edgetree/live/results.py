"""The result of one frame with the stems that are followed, and maps of them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

from basetree.arrays import Float
from edgetree.frames.pipeline import FrameResult
from edgetree.live.tracking.picture_tracker import PictureTracker
from edgetree.live.tracking.tracker import StemTracker
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import TreeMeasurement


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveResult(FrameResult):
    """The result of a frame, and the stems that are followed.

    Attributes:
        tracks: The stems that are followed in metres, seen in this frame or not. Those that are
            followed in the picture alone are in `found.tracks`.
        stages_ms: Time that each stage took for this frame, such as {"detect": 31.0}.
        age_s: Time from the arrival of the frame to this result, s.
        dropped: Frames that were left out so far because newer ones had arrived.
        followed_up: (3,) the vertical in the camera's frame by which the stems were followed: that
            of the frame or of its pose, or else that of the stems; None if it is not known.
    """

    tracks: list[TreeTrack]
    stages_ms: dict[str, float] = field(default_factory=dict)
    age_s: float = 0.0
    dropped: int = 0
    followed_up: Float | None = None

    @property
    def vertical(self) -> Float | None:
        """(3,) the vertical in the camera's frame, for places seen from above; None if unknown."""
        return self.frame.up_camera if self.followed_up is None else self.followed_up


def numbered_stems(result: FrameResult, stems: PictureTracker) -> FrameResult:
    """The result with the numbers of the stems, followed into this frame."""
    frame = result.frame
    tracks = stems.update(frame.image, result.trees, frame.stamp_s)
    return replace(result, found=replace(result.found, tracks=tracks))


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
    given = {each.name: getattr(result, each.name) for each in fields(FrameResult)}
    return LiveResult(**given, tracks=tracks, followed_up=tracker.up_camera)
