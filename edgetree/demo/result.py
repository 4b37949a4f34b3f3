"""The result of a demonstration, as plain data for the report and the JSON output."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from edgetree.bench.speed import BenchResult
from edgetree.check import Comparison
from edgetree.demo.comparison import (
    QUANTITIES,
    FrameComparison,
    QuantitySummary,
    compared,
    is_gross,
    summarise,
)
from edgetree.model_file.manifest import Manifest


class Step(NamedTuple):
    """One step of the training demonstration: name, outcome in words, and time."""

    name: str
    outcome: str
    duration_s: float


@dataclass(frozen=True)
class ModelResult:
    """The result of one model on all frames.

    Attributes:
        manifest: Description of the model.
        file_bytes: Size of the model file.
        speed: Time per frame on this machine.
        frames: Comparison with the ground truth for each frame.
    """

    manifest: Manifest
    file_bytes: int
    speed: BenchResult
    frames: tuple[FrameComparison, ...]

    @property
    def label(self) -> str:
        """The kind of the model in words."""
        return "depth model" if self.manifest.takes_depth else "colour model"

    @property
    def fps(self) -> float:
        """Frames per second at the median time."""
        return 1000.0 / self.speed.detect_p50_ms

    @property
    def fps_at_p90(self) -> float:
        """Frames per second at the 90th percentile of the time."""
        return 1000.0 / self.speed.detect_p90_ms

    @property
    def true_trees(self) -> int:
        """Number of labelled trees in the frames."""
        return sum(len(frame.trees) for frame in self.frames)

    @property
    def found_trees(self) -> int:
        """Number of labelled trees that were found."""
        return sum(tree.found for frame in self.frames for tree in frame.trees)

    @property
    def unmatched_detections(self) -> int:
        """Number of detections that match no labelled tree."""
        return sum(frame.unmatched_detections for frame in self.frames)

    def compared(self, quantity: str) -> list[Comparison]:
        """One of `QUANTITIES` of each tree where it was measured."""
        return compared(self.frames, quantity)

    def gross_errors(self, quantity: str) -> int:
        """Number of trees with a gross error of one of `QUANTITIES`."""
        return sum(is_gross(quantity, found) for found in self.compared(quantity))

    def summary(self, quantity: str) -> QuantitySummary:
        """The errors of one of `QUANTITIES`."""
        return summarise(self.frames, quantity)

    def to_dict(self) -> dict[str, Any]:
        """The result as a JSON object; units are in the keys."""
        return {
            "modality": self.manifest.modality,
            "name": self.manifest.name,
            "precision": self.manifest.precision,
            "input_width_px": self.manifest.input.width,
            "input_height_px": self.manifest.input.height,
            "file_bytes": self.file_bytes,
            "threads": self.speed.threads,
            "latency_p50_ms": self.speed.detect_p50_ms,
            "latency_p90_ms": self.speed.detect_p90_ms,
            "fps_p50": self.fps,
            "fps_p90": self.fps_at_p90,
            "true_trees": self.true_trees,
            "found_trees": self.found_trees,
            "unmatched_detections": self.unmatched_detections,
            "errors": {name: self.summary(name)._asdict() for name in QUANTITIES},
            "trees": [
                {"frame": tree.frame, **tree.to_dict()} for f in self.frames for tree in f.trees
            ],
        }


@dataclass(frozen=True)
class DemoResult:
    """The content of the report.

    Attributes:
        models: Results of at least one model, all on the same frames. The report's summary is
            about the first.
        duration_s: Time of the whole demonstration.
        peak_memory_mib: Peak memory of the process; None if not known.
        steps: Steps of the training demonstration; empty for the packaged models.
        figures: Measurements of these steps as a JSON object, with units in the keys.
    """

    models: tuple[ModelResult, ...]
    duration_s: float
    peak_memory_mib: float | None = None
    steps: tuple[Step, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)

    def to_dict(self, report: str) -> dict[str, Any]:
        """The JSON object of `edgetree demo --json`; `report` is the path of the report."""
        return {
            "schema": "edgetree.demo/1",
            "report": report,
            "duration_s": self.duration_s,
            "peak_memory_mib": self.peak_memory_mib,
            "models": {model.manifest.modality: model.to_dict() for model in self.models},
            **({"training": self.figures} if self.steps else {}),
        }
