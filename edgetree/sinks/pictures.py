"""Pictures with the trees drawn, and COCO labels to correct in a labelling tool."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from basetree.files.writing import output_folder, replacing, text_file
from calib import CocoLabels
from edgetree.detections import KEYPOINT_NAMES
from edgetree.frames.pipeline import FrameResult
from edgetree.results.pictures import draw_frame, encode_picture
from edgetree.sinks.sink import FileSink

# Lines between keypoints, as indices of KEYPOINT_NAMES: the stem's axis and the diameter.
_SKELETON: Final = ((0, 3), (3, 4), (1, 2))


class PicturesSink(FileSink[FrameResult]):
    """Draws each frame and writes it at once as `<frame name>_trees.jpg`.

    Args:
        folder: Where to; created if needed.

    Raises:
        InputError: The folder cannot be created or is not writable.
    """

    appears_whole = False

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = self._files.enter_context(output_folder(folder))

    def write(self, result: FrameResult) -> None:
        """Write one picture."""
        path = self._folder / f"{result.frame.name}_trees.jpg"
        data = encode_picture(draw_frame(result), path.suffix)
        with replacing(path) as file:
            file.write(data)


class CocoSink(FileSink[FrameResult]):
    """Writes the detections as a COCO file when it is closed, under the names of the images.

    Args:
        path: The file to write.
        model: Name of the model file, for the description in the labels.
        score_threshold: The detector's threshold, likewise.
        root: Folder that the names of the images are relative to; None for names alone.

    Raises:
        InputError: The file cannot be written.
    """

    def __init__(
        self, path: Path, model: str, score_threshold: float, root: Path | None = None
    ) -> None:
        super().__init__()
        self._root = root
        found = f"trees that {model} finds with a score of at least {score_threshold:g}"
        self._labels = CocoLabels("tree", KEYPOINT_NAMES, _SKELETON, f"{found}, to be corrected")
        self._files.enter_context(self._written(path))

    @contextmanager
    def _written(self, path: Path) -> Iterator[None]:
        with text_file(path) as stream:
            yield
            json.dump(self._labels.to_dict(), stream, allow_nan=False)

    def write(self, result: FrameResult) -> None:
        """Add a frame and its trees."""
        trees, frame = result.trees, result.frame
        name = frame.name if frame.path is None else frame.path.name
        if frame.path is not None and self._root is not None:
            name = frame.path.absolute().relative_to(self._root).as_posix()
        self._labels.add_image(name, trees.image_width, trees.image_height)
        for index, score in enumerate(trees.scores):
            points_px = None if trees.keypoints_px is None else trees.keypoints_px[index]
            box_px = trees.boxes_px[index].clip(0, [trees.image_width, trees.image_height] * 2)
            self._labels.add(box_px, float(score), result.found.mask(index), points_px)
