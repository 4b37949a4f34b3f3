"""What a demonstration found: plain data, from which the report and the JSON are made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from edgetree.demo.comparison import (
    QUANTITIES,
    FrameComparison,
    QuantitySummary,
    summarise,
)

__all__ = ["DemoResult", "ModelResult", "Picture", "Speed", "Step"]


class Speed(NamedTuple):
    """How long one frame takes, from the camera's pixels to detections; median and 90th centile."""

    p50_ms: float
    p90_ms: float
    threads: int

    @property
    def fps(self) -> float:
        """Frames a second at the median time."""
        return 1000.0 / self.p50_ms

    @property
    def fps_at_p90(self) -> float:
        """Frames a second that nine frames in ten keep up with."""
        return 1000.0 / self.p90_ms


class Picture(NamedTuple):
    """One frame as one model saw it, drawn on; `jpeg` is a whole file."""

    frame: str
    modality: str
    jpeg: bytes
    width_px: int
    height_px: int


class Step(NamedTuple):
    """One step of the chain in words: what was done, what came out, how long it took."""

    name: str
    outcome: str
    duration_s: float


@dataclass(frozen=True)
class ModelResult:
    """One model over all frames.

    Attributes:
        modality: `depth` or `rgb`.
        name: the model's own name.
        precision: of its weights and arithmetic.
        input_width_px: what the network sees; frames are letterboxed to it.
        input_height_px: likewise.
        file_bytes: size of the model file.
        speed: time per frame on this machine.
        frames: each frame's trees beside the truth.
    """

    modality: str
    name: str
    precision: str
    input_width_px: int
    input_height_px: int
    file_bytes: int
    speed: Speed
    frames: tuple[FrameComparison, ...]

    @property
    def true_trees(self) -> int:
        """How many labelled trees the frames hold."""
        return sum(len(frame.trees) for frame in self.frames)

    @property
    def found_trees(self) -> int:
        """How many of them were found."""
        return sum(tree.found for frame in self.frames for tree in frame.trees)

    @property
    def unmatched_detections(self) -> int:
        """Detections on no labelled tree."""
        return sum(frame.unmatched_detections for frame in self.frames)

    def summary(self, quantity: str) -> QuantitySummary:
        """How close one of `QUANTITIES` came."""
        return summarise(self.frames, quantity)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready; milliseconds, frames per second and metres as the keys say."""
        return {
            "modality": self.modality,
            "name": self.name,
            "precision": self.precision,
            "input_width_px": self.input_width_px,
            "input_height_px": self.input_height_px,
            "file_bytes": self.file_bytes,
            "threads": self.speed.threads,
            "latency_p50_ms": self.speed.p50_ms,
            "latency_p90_ms": self.speed.p90_ms,
            "fps_p50": self.speed.fps,
            "fps_p90": self.speed.fps_at_p90,
            "true_trees": self.true_trees,
            "found_trees": self.found_trees,
            "unmatched_detections": self.unmatched_detections,
            "errors": {name: self.summary(name)._asdict() for name in QUANTITIES},
            "trees": self._rows(),
        }

    def _rows(self) -> list[dict[str, Any]]:
        return [{"frame": f.frame, **tree.to_dict()} for f in self.frames for tree in f.trees]


@dataclass(frozen=True)
class DemoResult:
    """Everything the report shows.

    Attributes:
        models: at least one; the first is the one the summary speaks of. All saw the same frames.
        pictures: each frame as each model saw it.
        duration_s: of the whole demonstration.
        peak_memory_mib: highest memory of the process; None where the system does not say.
        steps: the chain from simulation to this file, empty for the embedded models.
        figures: what the chain measured, JSON-ready, with units in the keys.
    """

    models: tuple[ModelResult, ...]
    pictures: tuple[Picture, ...]
    duration_s: float
    peak_memory_mib: float | None = None
    steps: tuple[Step, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)

    def to_dict(self, report: str) -> dict[str, Any]:
        """The one JSON object of `edgetree demo --json`; `report` is where the report lies."""
        return {
            "schema": "edgetree.demo/1",
            "report": report,
            "duration_s": self.duration_s,
            "peak_memory_mib": self.peak_memory_mib,
            "models": {model.modality: model.to_dict() for model in self.models},
            **({"training": self.figures} if self.steps else {}),
        }
