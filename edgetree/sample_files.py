"""Write the sample frames as the files that the commands read."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from basetree.errors import InputError
from basetree.files.writing import replacing_folder, write_text, write_whole
from basetree.program.quoting import quoted
from calib import pixels_to_rays
from edgetree.samples import SampleFrame, SampleTree, sample_frames

_DRIVE = Path(__file__).parent / "assets" / "drive"
_CALIPER = "caliper.csv"


def write_samples(out: Path) -> None:
    """Write pictures, depth, camera, a drive and a caliper's table into a new folder.

    ====================  ========================================================================
    `pictures/`           colour, 1280x720
    `depth/`              depth of the same names, 16-bit millimetres
    `camera.json`         the camera of both
    `caliper.csv`         true diameters, for `edgetree check`
    `drive/`              frames of a machine that drives, with its motion, for `edgetree live`
    `README.txt`          what to do with them
    ====================  ========================================================================

    Args:
        out: Folder to make.

    Raises:
        InputError: If it exists and holds something, or cannot be written.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}: is not empty, expected a new folder")
    frames = sample_frames()
    out.resolve().parent.mkdir(parents=True, exist_ok=True)
    with replacing_folder(out) as folder:
        for frame in frames:
            _copy(frame.image_path, folder / "pictures" / frame.image_path.name)
            _copy(frame.depth_path, folder / "depth" / f"{frame.name}.png")
        for path in sorted(_DRIVE.rglob("*")):
            if path.is_file():
                _copy(path, folder / "drive" / path.relative_to(_DRIVE))
        camera = {"schema": "calib.camera/1", **frames[0].camera.to_dict()}
        write_text(folder / "camera.json", json.dumps(camera, indent=1) + "\n")
        write_text(folder / _CALIPER, _caliper_table(frames))
        commands = "".join(f"    {command}\n" for command in commands_for(Path()))
        write_text(folder / "README.txt", f"{_README}\n{commands}\n{_ABOUT_CHECK}")


_README = """Samples of edgetree: simulated frames, so that the true diameters are known.

Commands to try, in this folder:
"""

_ABOUT_CHECK = """The check ends with exit code 3: the stems of six pictures are too few to accept
a machine. It prints how far the diameters are off, and how many stems would be enough.
"""


def commands_for(folder: Path) -> list[str]:
    """Return commands that run on the files in a folder of `write_samples`, for a shell."""

    def place(name: str) -> str:
        return quoted((folder / name).as_posix())

    pictures, depth, camera, drive = map(place, ("pictures", "depth", "camera.json", "drive"))
    table, caliper, report, stems = map(
        place, ("trees.csv", _CALIPER, "trees.html", "stems.geojson")
    )
    picture, its_depth = place("pictures/sample_0.jpg"), place("depth/sample_0.png")
    rig = f"--camera {camera}"
    return [
        f"edgetree measure {picture} --depth {its_depth} {rig}",
        f"edgetree run {pictures} --depth {depth} {rig} --csv {table} --report {report}",
        f"edgetree check {table} {caliper}",
        f"edgetree live {drive} --map {stems}",
    ]


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    write_whole(target, source.read_bytes())


def _caliper_table(frames: list[SampleFrame]) -> str:
    """True diameters with the positions of the stems, in the camera's frame."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["frame", "x_m", "y_m", "z_m", "diameter_cm", "cut_height_cm"])
    for frame in frames:
        for tree, position in _visible(frame):
            at = [f"{value:.2f}" for value in position]
            figures = f"{100 * tree.diameter_m:.1f}", f"{100 * tree.cut_height_m:.1f}"
            writer.writerow([frame.name, *at, *figures])
    return text.getvalue()


def _visible(frame: SampleFrame) -> Iterator[tuple[SampleTree, tuple[float, ...]]]:
    """Yield the trees whose cut is in the frame, with its place in the camera's frame."""
    for tree in frame.trees:
        if tree.keypoints_px[0, 2] > 0:
            ray = pixels_to_rays(frame.camera, tree.keypoints_px[:1, :2])[0]
            yield tree, tuple(np.asarray(ray / np.linalg.norm(ray) * tree.distance_m).tolist())
