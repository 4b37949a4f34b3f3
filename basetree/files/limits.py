"""Limits on what is read: sizes of files and pictures, nesting, and counts.

The defaults are far above what real files need, and low enough that a broken or hostile file costs
seconds and not gigabytes. They apply to the whole process:

    before = set_limits(dataclasses.replace(current_limits(), image_pixels=400_000_000))
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from basetree.errors import InputError


@dataclass(frozen=True)
class Limits:
    """The largest inputs that are read. Larger ones are refused with an error.

    Attributes:
        text_file_bytes: Size of a camera, transform or depth scale file, a kit, a card, or a result
            of `edgetree bench`. YAML aliases count as if their text were written out.
        text_values: Values in such a file: numbers, texts, lists and maps.
        text_nesting: Levels of lists and maps in such a file, in other JSON files of this project,
            and in the records inside of model files, checkpoints and training states.
        image_pixels: Pixels of a picture, depth map or mask, width times height. Reading one may
            take 5 bytes of memory for each of these pixels: pictures of deep pixels may have fewer.
        cloud_points: Points of a point cloud. Reading one may take 100 bytes of memory for each,
            and its file may have 64 bytes for each.
        recording_chunk_bytes: Bytes of a chunk or message of a recording when it is unpacked.
        model_memory_bytes: Memory that opening a model file on the CPU may take, if it is less than
            640 MiB, 16 times the size of the file and 144 MiB for each thread together. Running it
            is not limited. On Linux alone.

    Raises:
        InputError: If a limit is not a whole number of at least 1.

    Examples:
        >>> from dataclasses import replace
        >>> from basetree.files import Limits
        >>> replace(Limits(), image_pixels=400_000_000).image_pixels
        400000000
    """

    text_file_bytes: int = 2 * 2**20
    text_values: int = 50_000
    text_nesting: int = 50
    image_pixels: int = 200_000_000
    cloud_points: int = 50_000_000
    recording_chunk_bytes: int = 256 * 2**20
    model_memory_bytes: int = 8 * 2**30

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InputError(
                    f"limit {field.name} is {value!r}: expected a whole number of at least 1"
                )


_current = Limits()


def current_limits() -> Limits:
    """Return the limits of this process."""
    return _current


def set_limits(limits: Limits) -> Limits:
    """Change the limits of this process, for all threads.

    Returns:
        The limits before, to set them again.
    """
    global _current
    before, _current = _current, limits
    return before
