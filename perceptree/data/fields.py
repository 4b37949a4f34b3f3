"""Check the fields of an image or annotation before it becomes a record."""

from __future__ import annotations

from basetree.files.limits import current_limits
from perceptree.data.entries import Entry, numbers, refuse, whole
from perceptree.data.names import KeypointMap
from perceptree.data.pictures import EXACT_FIELD, Pictures
from perceptree.keypoints import KEYPOINT_NAMES

_FILE_FIELDS = ("file_name", "depth_file", "depth8_file", EXACT_FIELD)
_STRIDE_FIELD = "depth_exact_stride_px"
_FLAGS = frozenset((0, 1, 2))
_IN_ORDER = tuple(range(len(KEYPOINT_NAMES)))
_MOST_PX = 1_000_000_000  # a sum of two still is a number of 32 bits
_NOTHING = [0.0] * (3 * len(KEYPOINT_NAMES))


def check_image(image: Entry, pictures: Pictures) -> bool:
    """Check an image's paths and size; a missing size becomes that of its picture.

    Returns:
        Whether the size was taken from the picture.

    Raises:
        EntryError: If a path or the size cannot be one.
    """
    for key in _FILE_FIELDS:
        name = image.get(key)
        if name is None and key != "file_name":
            continue
        if not isinstance(name, str) or not name or "\0" in name or not pictures.find(name, key):
            refuse(image, "image", key, "the path of a file in the dataset's folder")
    if _STRIDE_FIELD in image and whole(image, "image", _STRIDE_FIELD) < 1:
        refuse(image, "image", _STRIDE_FIELD, "at least 1 px")
    sized = not image.get("width") and not image.get("height") and pictures.give_size(image)
    for key in ("width", "height"):
        if isinstance(image.get(key), float | str):
            image[key] = _whole_size(image[key])
        if whole(image, "image", key) < 1:
            refuse(image, "image", key, "at least 1 px")
    largest = current_limits().image_pixels
    if image["width"] * image["height"] > largest:
        refuse(image, "image", "width", f"a picture of at most {largest} pixels")
    return sized


def _whole_size(value: float | str) -> float | str | int:
    """A size as a whole number, if it is one in another form such as 160.0 or "160"."""
    if isinstance(value, float):
        return int(value) if value.is_integer() else value
    return int(value) if value.isdecimal() and len(value) < 10 else value


def has_area(annotation: Entry) -> bool:
    """Whether an annotation's box has a width and a height over 0.

    Raises:
        EntryError: If the box is not four numbers of pixels.
    """
    x, y, width, height = box = numbers(annotation, "bbox", 4)
    if max(map(abs, box)) > _MOST_PX:
        refuse(annotation, "annotation", "bbox", f"pixels, up to {_MOST_PX}")
    return x + width > x and y + height > y


def keypoints_of(annotation: Entry, keypoints: KeypointMap) -> list[float]:
    """Return the five keypoints as on disk, [x, y, flag, ...]; zeros for missing ones.

    Raises:
        EntryError: If they are not x, y, flag of each.
    """
    if not annotation.get("keypoints"):
        return _NOTHING
    listed = numbers(annotation, "keypoints", 3 * keypoints.count)
    if listed and max(map(abs, listed)) > _MOST_PX:
        refuse(annotation, "annotation", "keypoints", f"pixels, up to {_MOST_PX}")
    if not _FLAGS.issuperset(listed[2::3]):
        refuse(annotation, "annotation", "keypoints", "flags of 0, 1 or 2")
    if keypoints.indices is None:
        return _NOTHING
    if keypoints.indices == _IN_ORDER and len(listed) == len(_NOTHING):
        return listed
    values: list[float] = []
    for index in keypoints.indices:
        values += [0.0] * 3 if index < 0 else listed[3 * index : 3 * index + 3]
    return values
