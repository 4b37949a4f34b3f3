"""The result of one live frame."""

from __future__ import annotations

from dataclasses import dataclass, field

from edgetree.detections import TreeDetections
from edgetree.live.frames import LiveFrame
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import TreeMeasurement

__all__ = ["LiveResult"]


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveResult:
    """What was found in one frame, and the stems that are followed.

    Attributes:
        frame: the frame.
        trees: its trees.
        measurements: one for each tree; None if depth or camera are missing.
        metres_need: why there are no measurements; None if there are.
        tracks: the stems that are followed, seen in this frame or not.
        stages_ms: time that each stage took for this frame, such as {"detect": 31.0}.
        age_s: time from the arrival of the frame to this result, s.
        dropped: frames that were left out so far because newer ones had arrived.
    """

    frame: LiveFrame
    trees: TreeDetections
    measurements: list[TreeMeasurement] | None
    metres_need: str | None
    tracks: list[TreeTrack]
    stages_ms: dict[str, float] = field(default_factory=dict)
    age_s: float = 0.0
    dropped: int = 0
