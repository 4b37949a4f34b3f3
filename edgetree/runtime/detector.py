"""The tree detector: from images to trees in pixel coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from edgetree.catalogue import find_model
from edgetree.detections import TreeDetections, UnlikeTraining
from edgetree.model_file.inputs_outputs import COLOUR, DEPTH, InputSpec
from edgetree.runtime.drawn_ground import frame_with_ground
from edgetree.runtime.duplicates import distinct_trees, joined
from edgetree.runtime.graph_checks import ImageOutputs, check_outputs, read_manifest
from edgetree.runtime.image_shift import unlike_training, what_helps
from edgetree.runtime.input_images import by_input, check_image, to_bytes
from edgetree.runtime.pairs import (
    ColourAndDepth,
    FrameImage,
    PreparedImages,
    check_camera,
    check_pair,
    depth_name,
    prepare_pair,
)
from edgetree.runtime.providers import CPU, SessionSettings
from edgetree.runtime.reach import within_reach
from edgetree.runtime.session import InferenceSession, OrtSession

Cameras: TypeAlias = Sequence[calib.PinholeCamera | None]
DISPLAY_THRESHOLD: Final = 0.5


class TreeDetector:
    """Detects trees in images. Thread-safe; usable after an error.

    Args:
        session: Runs the model's graph.
        score_threshold: Trees with a lower score are left out. The graph itself leaves out trees
            below a score of about 0.01.

    Attributes:
        session: Runs the model's graph.
        score_threshold: Lowest score of the returned trees.
        manifest: Description of the model.

    Raises:
        ModelFileError: The model has no manifest of edgetree, or one that contradicts its graph.
        InputError: The threshold is outside [0, 1].

    Examples:
        >>> from edgetree import TreeDetector, default_model, sample_frames
        >>> detector = TreeDetector.load(default_model("depth"))
        >>> trees = detector.detect(sample_frames()[0].depth_m())
        >>> (trees.boxes_px.shape[1], trees.keypoints_px.shape[1:])
        (4, (5, 3))
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
        require_signature: bool = False,
    ) -> TreeDetector:
        """Open a model file.

        `provider`, `strict`, `threads`, `spinning`, `cache_folder` and `require_signature` are
        described in `edgetree.runtime.SessionSettings`.

        Args:
            model: The .onnx file, or a name as for `default_model`, such as "edge-s-rgb". Beside
                the file's signature, no other file is read.
            provider: "cpu", "cuda", "tensorrt", "openvino", "coreml", "directml", or "auto".
            strict: Raise an error if the provider cannot be used, instead of using the CPU.
            threads: Threads of one inference on the CPU; None for all usable cores.
            spinning: Let idle threads spin.
            cache_folder: Where TensorRT, OpenVINO or CoreML store compiled models.
            score_threshold: Trees with a lower score are left out.
            warm_up: Call `warm_up` before returning.
            require_signature: Refuse a file without an accepted signature.

        Raises:
            ModelFileError: The file is missing, no model has the name, or the file is not an ONNX
                model, fails the safety check, or has no manifest of edgetree that matches its
                graph.
            SignatureError: a signature is required, and missing or not accepted.
            InputError: a setting is out of range, or the provider cannot be used.
            MissingPackage: Onnxruntime is not installed.
        """
        cache = None if cache_folder is None else Path(cache_folder)
        settings = SessionSettings(provider, strict, threads, spinning, cache, require_signature)
        detector = cls(OrtSession(find_model(model), settings), score_threshold=score_threshold)
        if warm_up:
            detector.warm_up()
        return detector

    def warm_up(self, rounds: int = 2) -> None:
        """Detect on blank images, so that the first real image is not slower than later ones.

        The first inference allocates memory and, on a GPU, chooses and compiles kernels.

        Args:
            rounds: Number of blank images for each model of the file.
        """
        blanks = [self._blank(target) for target in self.manifest.graph_inputs.values()]
        shown: list[FrameImage] = [*blanks[:1]]
        if len(blanks) == 2:
            shown = [ColourAndDepth(blanks[0], blanks[1])]
            if self.manifest.alone:
                near = np.zeros_like(blanks[1])
                shown += [ColourAndDepth(blanks[0], near), ColourAndDepth(None, near)]
        for _ in range(rounds):
            for image in shown:
                self.detect(image)

    def detect(
        self,
        image: FrameImage | None = None,
        depth_m: NDArray[Any] | None = None,
        camera: calib.PinholeCamera | None = None,
    ) -> TreeDetections:
        """Detect the trees in one image, or in colour and depth of one frame.

        A model takes of the two what it was made for. A model of colour and depth takes both, or
        either: an image that is missing, black, without readings, or alone unlike those of the
        training is left out, and `TreeDetections.alone` says so.

        Depth that shows stems without ground is looked at once more with a plane drawn through
        their feet (`edgetree.runtime.drawn_ground`).

        Args:
            image: An image of any size, contiguous or not. For an rgb model and one of both uint8
                (H, W, 3), BGR as read by OpenCV. A depth model takes its depth also here.
            depth_m: Depth of the same camera and size: float (H, W), metres along the optical axis,
                where 0.0, NaN and infinity mean no reading; or uint8 (H, W), encoded as described
                in the manifest.
            camera: Camera of the images, of their size. With it and with depth that the model
                takes, trees that stand further away than those of its training are left out
                (`edgetree.runtime.reach`). None if it is not known.

        Returns:
            The trees that reach the score threshold, in pixels of `image`, by descending score. Of
            trees whose masks cover each other, only the one with the highest score.

        Raises:
            InputError: An image is not an array of this shape and dtype, is empty, or has negative
                depths; there is none that the model takes; or the camera is of another size.
            ModelFileError: The model fails, or its outputs contradict its manifest.
        """
        if depth_m is not None:
            if isinstance(image, ColourAndDepth):
                raise InputError("depth_m is given with a ColourAndDepth: expected one of them")
            image = ColourAndDepth(image, depth_m)
        (found,) = self._detect_all([self._checked(image, "image", camera)], [camera])
        return found

    def _within_reach(
        self, found: TreeDetections, image: FrameImage, camera: calib.PinholeCamera | None
    ) -> TreeDetections:
        """The found trees whose scores are still high enough after `reach.within_reach`."""
        if camera is None:
            return found
        alone = None if found.alone is None else found.alone.image
        reach_m = self.manifest.shown(alone).reach_m
        if alone == COLOUR:
            return found
        depth = image.depth_m if isinstance(image, ColourAndDepth) else image
        if reach_m is None or self._encoding is None or depth is None:
            return found
        depth_m = calib.decode_depth(depth, self._encoding) if depth.dtype == np.uint8 else depth
        return within_reach(found, depth_m, camera, reach_m).above(self.score_threshold)

    def detect_batch(
        self,
        images: Sequence[FrameImage],
        cameras: Cameras | None = None,
    ) -> list[TreeDetections]:
        """Detect the trees in several images, which may differ in size.

        Images are run in batches of the size that the model file was exported for, or the largest
        size it was verified for. An incomplete batch is filled up with blank images.

        Args:
            images: Images as for `detect`; colour and depth of a frame as a `ColourAndDepth`.
            cameras: The camera of each image as for `detect`; None if none is known.

        Returns:
            The result of `detect` for each image.

        Raises:
            InputError: As for `detect`, with the index of the image, or there are more or fewer
                cameras than images; raised before any inference.
            ModelFileError: As for `detect`.
        """
        each: Cameras = [None] * len(images) if cameras is None else list(cameras)
        if len(each) != len(images):
            raise InputError(f"{len(each)} cameras for {len(images)} images: expected one of each")
        pairs = enumerate(zip(images, each, strict=True))
        checked = [self._checked(image, f"images[{i}]", camera) for i, (image, camera) in pairs]
        return self._detect_all(checked, each)

    def _checked(
        self, image: FrameImage | None, name: str, camera: calib.PinholeCamera | None = None
    ) -> FrameImage:
        """The image that the model takes, or both of a frame; raises InputError."""
        found = self._taken(image, name)
        if camera is not None:
            check_camera(camera, found, name)
        return found

    def _taken(self, image: FrameImage | None, name: str) -> FrameImage:
        manifest = self.manifest
        if manifest.takes_both:
            pair = image if isinstance(image, ColourAndDepth) else ColourAndDepth(image, None)
            return check_pair(pair, name, manifest)
        if isinstance(image, ColourAndDepth):
            image, name = (
                (image.depth_m, depth_name(name)) if manifest.takes_depth else (image.image, name)
            )
        return check_image(image, name, manifest)

    def prepare(self, image: FrameImage) -> NDArray[np.uint8]:
        """The network's input for one image: depth encoded, resized, and padded to its size.

        Args:
            image: An image as for `detect`.

        Returns:
            (H, W, 3) or (H, W) of the manifest's input size; (H, W, 4) of both, the depth last.

        Raises:
            InputError: As for `detect`.
        """
        planes = self._prepare(self._checked(image, "image")).planes
        return planes[0] if len(planes) == 1 else np.dstack(planes)

    def inputs_of(self, prepared: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
        """The graph's inputs for prepared images: these, and the lowest score that is wanted.

        Args:
            prepared: (B, ...) results of `prepare`.
        """
        return by_input(prepared, self.manifest) | self._lowest_score()

    def _lowest_score(self) -> dict[str, NDArray[Any]]:
        """The optional input of that name, where the graph has one."""
        thresholds = self.manifest.thresholds
        if thresholds.score_input is None:
            return {}
        lowest = max(self.score_threshold, thresholds.score)
        return {thresholds.score_input: np.array([lowest], np.float32)}

    def _prepare(self, image: FrameImage) -> PreparedImages:
        if isinstance(image, ColourAndDepth):
            assert self._encoding is not None
            found = prepare_pair(image, self.manifest, self._encoding)
            return replace(found, unlike=self._advised(found.unlike))
        target = self.manifest.input
        letterbox = calib.Letterbox.fit(image.shape[1], image.shape[0], target.width, target.height)
        pad_value = self.manifest.resize.pad_value
        pixels = letterbox.apply(to_bytes(image, self._encoding), pad_value)
        return PreparedImages(letterbox, (pixels,), None, self._unlike(pixels, letterbox))

    def _detect_all(self, images: list[FrameImage], cameras: Cameras) -> list[TreeDetections]:
        """The trees of checked images, of those without ground also with ground drawn in."""
        drawn = {}
        for index, image in enumerate(images):
            with_plane = frame_with_ground(image)
            if with_plane is not None:
                drawn[index] = with_plane
        found = self._in_batches(images + list(drawn.values()))
        for index, again in zip(drawn, found[len(images) :], strict=True):
            found[index] = joined(again, found[index], self.manifest.thresholds.mask_overlap)
        each = zip(images, found, cameras, strict=False)
        return [
            self._within_reach(self._with_drawn(image, trees), image, camera)
            for image, trees, camera in each
        ]

    def _with_drawn(self, image: FrameImage, found: TreeDetections) -> TreeDetections:
        """Of a combined file that was shown depth alone: the trees with ground drawn in, too."""
        alone = found.alone
        if not (self.manifest.alone and alone and isinstance(image, ColourAndDepth)):
            return found
        depth_m = image.depth_m if alone.image == DEPTH else None
        drawn = None if depth_m is None else frame_with_ground(depth_m)
        if drawn is None:
            return found
        (again,) = self._in_batches([ColourAndDepth(None, drawn)])
        most = self.manifest.thresholds.mask_overlap
        return replace(joined(again, found, most), unlike=found.unlike, alone=alone)

    def _in_batches(self, images: list[FrameImage]) -> list[TreeDetections]:
        found: list[TreeDetections] = []
        for size in self._batch_sizes(len(images)):
            found += self._detect_together(images[len(found) : len(found) + size], size)
        return found

    def _batch_sizes(self, images: int) -> Iterator[int]:
        """The sizes of the batches that `images` images are run in."""
        target = self.manifest.input
        fixed = self.session.input_shapes[target.name][0]
        while images > 0:
            verified = [size for size in target.batch_sizes if size <= images]
            size = fixed if isinstance(fixed, int) else max(verified, default=1)
            yield size
            images -= size

    def _detect_together(self, images: list[FrameImage], batch: int) -> list[TreeDetections]:
        """Run the graph once, on up to `batch` images."""
        prepared = [self._prepare(image) for image in images]
        inputs: dict[str, NDArray[Any]] = self._lowest_score()
        for number, target in enumerate(self.manifest.graph_inputs.values()):
            pixels = [each.planes[number] for each in prepared]
            pixels += [self._blank(target)] * (batch - len(images))
            inputs[target.name] = pixels[0][None] if batch == 1 else np.stack(pixels)
        outputs = self.session.run(inputs)
        found = check_outputs(outputs, self.manifest, batch, self.session.name)
        return [self._to_image(rows, each) for rows, each in zip(found, prepared, strict=False)]

    def _blank(self, target: InputSpec) -> NDArray[np.uint8]:
        """An image of padding alone for an input."""
        return np.full(target.image_shape, self.manifest.pad_value_of(target), np.uint8)

    def _unlike(
        self, image: NDArray[np.uint8], letterbox: calib.Letterbox
    ) -> UnlikeTraining | None:
        """How a letterboxed image differs from the training images, if it does clearly."""
        usual = self.manifest.training_pictures
        if not usual:
            return None
        inner = image[: letterbox.resized_height, : letterbox.resized_width]
        return self._advised(
            unlike_training(calib.picture_statistics(inner, self._encoding), usual)
        )

    def _advised(self, found: UnlikeTraining | None) -> UnlikeTraining | None:
        """The same, with what to try."""
        if found is None:
            return None
        used = Path(self.session.name).stem
        advice = what_helps(self.manifest.modality, used, self.score_threshold)
        return replace(found, advice=advice)

    def _to_image(self, rows: ImageOutputs, prepared: PreparedImages) -> TreeDetections:
        """Select trees by score and map them from the model's input to the image."""
        letterbox = prepared.letterbox
        width, height = letterbox.source_width, letterbox.source_height
        boxes = letterbox.to_source(rows.boxes.reshape(-1, 2)).reshape(-1, 4)
        in_view = (boxes[:, :2] < [width, height]).all(axis=1)
        shown = np.flatnonzero(in_view & (rows.scores >= self.score_threshold))
        if rows.masks is not None:
            most = self.manifest.thresholds.mask_overlap
            shown = shown[distinct_trees(rows.boxes[shown], rows.masks[shown], most)]
        shown_alone = None if prepared.alone is None else prepared.alone.image
        points, stds = rows.keypoints, rows.keypoint_stds
        if points is not None:
            points = points[shown]
            xy = letterbox.to_source(points[..., :2].reshape(-1, 2)).reshape(*points.shape[:2], 2)
            points = np.concatenate([xy, points[..., 2:]], axis=2)
        if stds is not None:
            stds = (np.abs(stds[shown]) / letterbox.scale).astype(np.float32)
        return TreeDetections(
            boxes_px=boxes[shown],
            scores=rows.scores[shown],
            keypoints_px=points,
            keypoint_stds_px=stds,
            masks=None if rows.masks is None else rows.masks[shown],
            image_width=width,
            image_height=height,
            unlike=prepared.unlike,
            alone=prepared.alone,
            error_factor=self.manifest.shown(shown_alone).error_factor,
            by_network=True,
        )
