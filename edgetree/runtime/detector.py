"""The detector: images in, trees in those images' pixels out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import calib
from edgetree.detections import TreeDetections
from edgetree.errors import InputError
from edgetree.runtime.graph_checks import Answer, check_answer, read_manifest
from edgetree.runtime.input_images import check_image, to_bytes
from edgetree.runtime.providers import CPU, SessionSettings
from edgetree.runtime.session import InferenceSession, OrtSession

__all__ = ["DISPLAY_THRESHOLD", "MODALITIES", "TreeDetector", "default_model"]

DISPLAY_THRESHOLD: Final = 0.5
MODALITIES: Final = ("rgb", "depth")


def default_model(modality: str) -> Path:
    """The model file that comes with this package for "rgb" or "depth".

    Raises:
        InputError: another modality.
    """
    if modality not in MODALITIES:
        raise InputError(f"modality is {modality!r}: expected 'rgb' or 'depth'")
    return Path(__file__).parents[1] / "assets" / "models" / f"{modality}.onnx"


class TreeDetector:
    """A model, ready to detect. One detector may be used from many threads at once, and after an
    error as before it.

    Args:
        session: what runs the graph.
        score_threshold: trees below it are left out. The graph itself keeps all from about 0.01.

    Raises:
        ModelFileError: the model carries no manifest of ours, or one that is not its own.
        InputError: the threshold is not in 0 to 1.
    """

    def __init__(
        self, session: InferenceSession, *, score_threshold: float = DISPLAY_THRESHOLD
    ) -> None:
        if not 0.0 <= score_threshold <= 1.0:
            raise InputError(f"score threshold is {score_threshold}: expected 0 to 1")
        self.session = session
        self.score_threshold = score_threshold
        self.manifest = read_manifest(session)
        encoding = self.manifest.depth_encoding
        self._encoding = None if encoding is None else calib.DepthEncoding.from_dict(dict(encoding))

    @classmethod
    def load(
        cls,
        model: Path | str,
        *,
        provider: str = CPU,
        strict: bool = True,
        threads: int | None = None,
        spinning: bool = False,
        cache_folder: Path | str | None = None,
        score_threshold: float = DISPLAY_THRESHOLD,
        warm_up: bool = False,
    ) -> TreeDetector:
        """Open a model file, which is all that is read.

        Args:
            model: the .onnx file.
            provider: "cpu", "cuda", "tensorrt", "openvino", "coreml", "directml", or "auto"; this
                and the next four as `edgetree.runtime.providers.SessionSettings` has them.
            strict: a provider that cannot be used is an error; off, the processor takes over.
            threads: threads of one inference on the processor; None takes all usable cores.
            spinning: let idle threads spin.
            cache_folder: where TensorRT, OpenVINO or CoreML keep what they make of the model.
            score_threshold: trees below it are left out.
            warm_up: see `warm_up`.

        Raises:
            ModelFileError: the file is missing, no ONNX model, has no manifest of ours, or one
                that its graph contradicts; or it is one that may not be opened.
            InputError: a setting is out of range, or the provider cannot be used.
        """
        cache = None if cache_folder is None else Path(cache_folder)
        settings = SessionSettings(provider, strict, threads, spinning, cache)
        detector = cls(OrtSession(Path(model), settings), score_threshold=score_threshold)
        if warm_up:
            detector.warm_up()
        return detector

    def warm_up(self, rounds: int = 2) -> None:
        """Detect on blank images, so that the first real one takes no longer than the next.

        The first inference lays out memory, and on a GPU chooses and compiles kernels.
        """
        shape = self.manifest.input.image_shape
        blank = np.full(shape, self.manifest.resize.pad_value, np.uint8)
        for _ in range(rounds):
            self.detect(blank)

    def detect(self, image: NDArray[Any]) -> TreeDetections:
        """Find the trees of one image, best first.

        Args:
            image: of any size, contiguous or not. RGB model: uint8 (H, W, 3), BGR as OpenCV reads
                it. Depth model: float (H, W), metres along the optical axis, where 0.0, NaN and
                infinities stand for no reading, as camera drivers differ; or uint8 (H, W) already
                encoded as the manifest says.

        Returns:
            The trees from the score threshold on, in pixels of `image`.

        Raises:
            InputError: not an array, another shape or dtype, no pixels, or a negative depth.
            ModelFileError: the model fails, or answers with what no model of ours would.
        """
        return self._detect_all([check_image(image, "image", self.manifest)])[0]

    def detect_batch(self, images: Sequence[NDArray[Any]]) -> list[TreeDetections]:
        """Find the trees of several images, each of any size and as `detect` takes them.

        They go through the graph together, as many at once as the model file takes, or was
        verified for. A file made for four at once is filled up where there are fewer.

        Returns:
            What `detect` gives for each.

        Raises:
            InputError: as `detect`; the message says which, and nothing has been run then.
            ModelFileError: as `detect`.
        """
        return self._detect_all(
            [
                check_image(image, f"images[{index}]", self.manifest)
                for index, image in enumerate(images)
            ]
        )

    def _detect_all(self, images: list[NDArray[Any]]) -> list[TreeDetections]:
        found: list[TreeDetections] = []
        for size in self._batch_sizes(len(images)):
            found += self._detect_together(images[len(found) : len(found) + size], size)
        return found

    def _batch_sizes(self, images: int) -> Iterator[int]:
        """How many images go through the graph at once, in turn."""
        target = self.manifest.input
        fixed = self.session.input_shapes[target.name][0]
        while images > 0:
            verified = [size for size in target.batch_sizes if size <= images]
            size = fixed if isinstance(fixed, int) else max(verified, default=1)
            yield size
            images -= size

    def _detect_together(self, images: list[NDArray[Any]], batch: int) -> list[TreeDetections]:
        """One run of the graph, on up to `batch` images."""
        target = self.manifest.input
        pad_value = self.manifest.resize.pad_value
        letterboxes = [
            calib.Letterbox.fit(image.shape[1], image.shape[0], target.width, target.height)
            for image in images
        ]
        pixels = [
            letterbox.apply(to_bytes(image, self._encoding), pad_value)
            for letterbox, image in zip(letterboxes, images, strict=True)
        ]
        pixels += [np.full(target.image_shape, pad_value, np.uint8)] * (batch - len(images))
        stacked = pixels[0][None] if batch == 1 else np.stack(pixels)
        outputs = self.session.run({target.name: stacked})
        answers = check_answer(outputs, self.manifest, batch, self.session.name)
        return [
            self._read(answer, letterbox)
            for answer, letterbox in zip(answers, letterboxes, strict=False)
        ]

    def _read(self, answer: Answer, letterbox: calib.Letterbox) -> TreeDetections:
        """The rows to show, from the input's pixels back to the image's."""
        width, height = letterbox.source_width, letterbox.source_height
        boxes = letterbox.to_source(answer.boxes.reshape(-1, 2)).reshape(-1, 4)
        in_view = (boxes[:, :2] < [width, height]).all(axis=1)
        shown = in_view & (answer.scores >= self.score_threshold)
        points = answer.keypoints
        if points is not None:
            points = points[shown]
            xy = letterbox.to_source(points[..., :2].reshape(-1, 2)).reshape(*points.shape[:2], 2)
            points = np.concatenate([xy, points[..., 2:]], axis=2)
        return TreeDetections(
            boxes_px=boxes[shown],
            scores=answer.scores[shown],
            keypoints_px=points,
            masks=None if answer.masks is None else answer.masks[shown],
            image_width=width,
            image_height=height,
        )
