"""Write a dataset into a new folder, in one of the forms that are known."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

from basetree.errors import SettingsError
from basetree.files.writing import replacing_folder
from perceptree.data.coco import FrameRecord
from perceptree.data.exchange.write_coco import write_coco
from perceptree.data.exchange.write_labelme import write_labelme
from perceptree.data.exchange.write_yolo import write_yolo
from perceptree.data.stated import stated, write_stated
from perceptree.errors import DatasetError

_Writer = Callable[[Path, Mapping[str | None, Sequence[FrameRecord]]], list[str]]
_WRITERS: dict[str, _Writer] = {
    "coco": write_coco,
    "yolo-seg": partial(write_yolo, keypoints=False),
    "yolo-pose": partial(write_yolo, keypoints=True),
    "labelme": write_labelme,
}
WRITTEN_FORMS = tuple(_WRITERS)


def check_output(out: Path, form: str, source: Path) -> None:
    """Check where and how a dataset is to be written, before anything is read.

    Raises:
        SettingsError: If the form is not known.
        DatasetError: If the folder holds something, or is part of the source or around it.
    """
    if form not in _WRITERS:
        raise SettingsError(f"--to is {form!r}: expected one of {', '.join(_WRITERS)}")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DatasetError(f"--out {out}: is not empty, expected a new folder")
    if source.resolve().is_relative_to(out.resolve()):
        raise DatasetError(f"--out {out}: the labels are in it, expected another folder")


def write_dataset(
    out: Path,
    splits: Mapping[str | None, Sequence[FrameRecord]],
    form: str = "coco",
    sources: Iterable[Path] = (),
) -> list[str]:
    """Write labels and copies of the pictures; the folder appears when all is there.

    What the datasets that the frames come from state of their photographs and of the reach of
    their labels is passed on in `settings.json`.

    Args:
        out: Folder to make.
        splits: Frames of each split; None for frames without a split.
        form: One of `WRITTEN_FORMS`.
        sources: Folders of the datasets that the frames come from.

    Returns:
        Messages for the user about what the form cannot hold, and pictures that do not fit.

    Raises:
        DatasetError: If a picture, or what a dataset states, cannot be read.
        UnwritableFile: If a file cannot be written.
    """
    passed_on = stated(sources)
    out.resolve().parent.mkdir(parents=True, exist_ok=True)
    with replacing_folder(out) as folder:
        write_stated(folder, passed_on)
        return _WRITERS[form](folder, splits)
