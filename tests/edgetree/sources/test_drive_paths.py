"""Labels of a drive name files inside its dataset alone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError
from edgetree.sources import open_drive

OUTSIDE = ("../../x.jpg", "images/../../x.jpg", "/etc/hostname", "", "..", "C:\\x.jpg", "a\0b")


@pytest.mark.parametrize("name", [*OUTSIDE, "{absolute}", "images\\..\\..\\x.jpg"])
@pytest.mark.parametrize("field", ["file_name", "depth_file"])
def test_a_file_outside_the_dataset_is_not_read(
    write_drive: Callable[..., Path], run_cli: Callable[..., Any], field: str, name: str
) -> None:
    folder = write_drive(frames=2)
    labels = json.loads((folder / "test_RGB.json").read_text())
    place = labels["images"][1]
    # A picture that could be read, but not of this dataset.
    outside = folder.parent.parent / "x.jpg"
    shutil.copy(folder / place[field], outside)
    place[field] = name.format(absolute=outside)
    (folder / "test_RGB.json").write_text(json.dumps(labels))
    with pytest.raises(InputError, match=r"name the file .*: expected a path inside the dataset"):
        open_drive(folder)
    done = run_cli("live", folder)
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    outside.unlink()


def test_other_paths_inside_are_read(write_drive: Callable[..., Path]) -> None:
    folder = write_drive(frames=1)
    labels = json.loads((folder / "test_RGB.json").read_text())
    (folder / "more" / "deep..").mkdir(parents=True)
    name = "more/deep../a..b.jpg"
    (folder / labels["images"][0]["file_name"]).rename(folder / name)
    labels["images"][0]["file_name"] = f"./{name}"
    (folder / "test_RGB.json").write_text(json.dumps(labels))
    (frame,) = open_drive(folder)
    assert frame.image is not None
