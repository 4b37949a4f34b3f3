"""The detector: an image in, trees in that image's pixels out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import calib
from edgetree.detections import TreeDetections
from edgetree.errors import InputError, ModelFileError
from edgetree.manifest import METADATA_KEY, Manifest
from edgetree.session import InferenceSession, OrtSession

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
    return Path(__file__).parent / "assets" / "models" / f"{modality}.onnx"


class TreeDetector:
    """A model, ready to detect.

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
        self.manifest = _read_manifest(session)
        encoding = self.manifest.depth_encoding
        self._encoding = None if encoding is None else calib.DepthEncoding.from_dict(dict(encoding))

    @classmethod
    def load(
        cls,
        model: Path | str,
        *,
        threads: int | None = None,
        spinning: bool = False,
        score_threshold: float = DISPLAY_THRESHOLD,
    ) -> TreeDetector:
        """Open a model file; `threads` and `spinning` as `OrtSession` has them.

        Raises:
            ModelFileError: the file is missing, no ONNX model, or has no manifest of ours.
            InputError: a setting is out of range.
        """
        session = OrtSession(Path(model), threads=threads, spinning=spinning)
        try:
            return cls(session, score_threshold=score_threshold)
        except (ModelFileError, calib.CalibError) as error:
            raise ModelFileError(f"model {model}: {error}") from error

    def detect(self, image: NDArray[Any]) -> TreeDetections:
        """Find the trees of one image, best first.

        Args:
            image: of any size. RGB model: uint8 (H, W, 3), BGR as OpenCV reads it. Depth model:
                float (H, W), metres along the optical axis with 0.0 where there is no reading,
                or uint8 (H, W) already encoded as the manifest says.

        Returns:
            The trees from the score threshold on, in pixels of `image`.

        Raises:
            InputError: another shape or dtype.
        """
        image = self._as_bytes(image)
        height, width = image.shape[:2]
        target = self.manifest.input
        letterbox = calib.Letterbox.fit(width, height, target.width, target.height)
        pixels = letterbox.apply(image, self.manifest.resize.pad_value)
        outputs = self.session.run({target.name: pixels[None]})
        return self._read_outputs(outputs, letterbox, width, height)

    def _as_bytes(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """The image as the bytes that the model was trained on, still at its own size."""
        found = f"{image.dtype} {image.shape}"
        if self._encoding is None:
            if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                raise InputError(f"image is {found}: expected uint8 (H, W, 3) BGR")
        elif image.ndim != 2 or not (image.dtype == np.uint8 or image.dtype.kind == "f"):
            raise InputError(
                f"depth image is {found}: expected float (H, W) metres or uint8 (H, W) encoded"
            )
        if image.size == 0:
            raise InputError(f"image is {found}: expected at least one pixel")
        if self._encoding is not None and image.dtype != np.uint8:
            return calib.encode_depth(image.astype(np.float32, copy=False), self._encoding)
        return image

    def _read_outputs(
        self,
        outputs: dict[str, NDArray[Any]],
        letterbox: calib.Letterbox,
        width: int,
        height: int,
    ) -> TreeDetections:
        """The rows in use, from the input's pixels back to the image's."""
        count = int(outputs["num_detections"][0])
        boxes = letterbox.to_source(outputs["boxes"][0, :count].reshape(-1, 2)).reshape(-1, 4)
        points = outputs["keypoints"][0, :count] if "keypoints" in outputs else None
        if points is not None:
            xy = letterbox.to_source(points[..., :2].reshape(-1, 2)).reshape(*points.shape[:2], 2)
            points = np.concatenate([xy, points[..., 2:]], axis=2)
        trees = TreeDetections(
            boxes_px=boxes,
            scores=outputs["scores"][0, :count],
            keypoints_px=points,
            masks=outputs["masks"][0, :count] if "masks" in outputs else None,
            image_width=width,
            image_height=height,
        )
        in_view = (boxes[:, :2] < [width, height]).all(axis=1)
        return trees.select(in_view & (trees.scores >= self.score_threshold))


def _read_manifest(session: InferenceSession) -> Manifest:
    """The session's manifest, held against the graph's own inputs and outputs."""
    text = session.metadata.get(METADATA_KEY)
    if text is None:
        raise ModelFileError(
            f"an ONNX model without a manifest (metadata {METADATA_KEY!r}):"
            " expected a file made by `edgetree export`"
        )
    manifest = Manifest.from_json(text)
    expected = manifest.input.image_shape
    shapes = session.input_shapes
    found = shapes.get(manifest.input.name, ())
    if set(shapes) != {manifest.input.name} or found[1:] != expected:
        raise ModelFileError(
            f"the graph's inputs are {dict(shapes)}: expected, as its manifest says,"
            f" {manifest.input.name!r} of (batch, {', '.join(map(str, expected))})"
        )
    if set(session.output_names) != set(manifest.output_names):
        raise ModelFileError(
            f"the graph's outputs are {session.output_names}: expected, as its manifest says,"
            f" {manifest.output_names}"
        )
    return manifest
