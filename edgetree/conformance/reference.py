"""This package as the program that finds a kit's trees."""

from __future__ import annotations

import dataclasses
import platform
from pathlib import Path
from typing import Final

import numpy as np

from basetree.errors import InputError
from calib import PinholeCamera
from calib.depth.convention import in_metres
from edgetree.conformance.frames import FramePixels
from edgetree.conformance.results import CoveredTree, FrameTrees, Results, found_trees
from edgetree.detections import TreeDetections
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.duplicates import distinct_trees
from edgetree.runtime.pairs import ColourAndDepth, FrameImage
from edgetree.runtime.providers import CPU, import_onnxruntime

_PROCESSORS: Final = {"x86_64": "x86-64", "amd64": "x86-64", "aarch64": "arm64"}
_OVERLAPS: Final = 101


def processor_kind() -> str:
    """The kind of this machine's processor: "x86-64", "arm64" or Python's word for it."""
    machine = platform.machine().lower()
    return _PROCESSORS.get(machine, machine)


class Reference:
    """Detects trees in the frames of a kit.

    Args:
        model: The model file.
        score_threshold: Trees with a lower score are left out.
        provider: What runs the network, a name in `edgetree.runtime.PROVIDERS`.
        threads: Threads of one inference; None for all usable cores.
    """

    def __init__(
        self,
        model: Path,
        *,
        score_threshold: float,
        provider: str = CPU,
        threads: int | None = None,
    ) -> None:
        self._detector = TreeDetector.load(
            model, provider=provider, threads=threads, score_threshold=score_threshold
        )
        session = self._detector.session
        # Programs in other languages leave out no image that is unlike those of the training.
        alone = {
            kind: dataclasses.replace(each, training_pictures=())
            for kind, each in self.manifest.alone.items()
        }
        self._detector.manifest = dataclasses.replace(
            self.manifest, training_pictures=(), alone=alone
        )
        self._all = TreeDetector(session, score_threshold=score_threshold)
        thresholds = dataclasses.replace(self.manifest.thresholds, mask_overlap=1.0)
        self._all.manifest = dataclasses.replace(self.manifest, thresholds=thresholds)

    @property
    def manifest(self) -> Manifest:
        """Description of the model."""
        return self._detector.manifest

    def detect(self, pixels: FramePixels, camera: PinholeCamera | None = None) -> TreeDetections:
        """The trees in one frame, given as in `edgetree.conformance.kit.read_frame`."""
        return self._detector.detect(self._image(pixels), camera=camera)

    def detect_with_covered(
        self, name: str, pixels: FramePixels, camera: PinholeCamera | None = None
    ) -> FrameTrees:
        """The trees in one frame, and those that were left out since a better one covers them."""
        kept = self.detect(pixels, camera)
        every = self._all.detect(self._image(pixels), camera=camera)
        covered = []
        for index in range(len(every)):
            one = every.select(slice(index, index + 1))
            if not (one.boxes_px == kept.boxes_px).all(1).any():
                covered.append(CoveredTree(_covering(kept, one), found_trees(one)[0]))
        return FrameTrees(name, found_trees(kept), tuple(covered))

    def results(
        self, sha256: str, frames: tuple[FrameTrees, ...], median_ms: float | None = None
    ) -> Results:
        """What was found, with the runtime and the processor that found it."""
        session, version = self._detector.session, import_onnxruntime().__version__
        on_cpu = session.provider == CPU
        return Results(
            model_sha256=sha256,
            runtime="onnxruntime" if on_cpu else session.provider,
            runtime_version=version if on_cpu else f"in onnxruntime {version}",
            processor=processor_kind(),
            frames=frames,
            host="edgetree in Python",
            median_ms=median_ms,
            threads=session.threads,
        )

    def _image(self, pixels: FramePixels) -> FrameImage:
        """The image as `TreeDetector.detect` takes it: BGR, or metres, or both."""
        manifest = self.manifest
        images = pixels if isinstance(pixels, tuple) else (pixels,)
        colour = next((each for each in images if each.ndim == 3), None)
        depth = next((each for each in images if each.ndim == 2), None)
        depth_m = None if depth is None else in_metres(depth, 0.001)
        if manifest.takes_both:
            return ColourAndDepth(colour, depth_m)
        image = depth_m if manifest.takes_depth else colour
        if image is None or len(images) > 1:
            found = " and ".join(f"{each.dtype} {each.shape}" for each in images)
            raise InputError(f"a frame is {found}: the model takes {manifest.images} images")
        return image


def _covering(kept: TreeDetections, covered: TreeDetections) -> int:
    """Index of the kept tree that has most in common with a tree."""
    if kept.masks is None or covered.masks is None:
        raise ValueError("the trees have no masks: expected no tree that another one covers")
    for overlap in np.linspace(1.0, 0.0, _OVERLAPS):
        for index in range(len(kept)):
            boxes = np.concatenate([kept.boxes_px[[index]], covered.boxes_px])
            masks = np.concatenate([kept.masks[[index]], covered.masks])
            if not distinct_trees(boxes, masks, float(overlap))[1]:
                return index
    raise ValueError("the tree has nothing in common with those kept: expected one that covers it")
