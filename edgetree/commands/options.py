"""Options that several commands share."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

if TYPE_CHECKING:
    from calib import PinholeCamera
    from edgetree.frames.rig import Rig
    from edgetree.measure import MeasureSettings
    from edgetree.runtime.detector import TreeDetector

__all__ = [
    "CAMERA_FILES",
    "Camera",
    "Csv",
    "Depth",
    "DepthCamera",
    "DepthExtrinsics",
    "DepthScale",
    "Json",
    "Model",
    "Mounting",
    "Provider",
    "RigOptions",
    "ScoreThreshold",
    "Strict",
    "StumpHeight",
    "Threads",
    "Up",
    "model_record",
    "open_model",
    "quoted",
]

CAMERA_FILES = (
    "Of this project (calib.camera/1 JSON), ROS, OpenCV, Kalibr, CamOdoCal, RealSense or ZED;"
    " NAME chooses among several cameras in one file."
)

Json: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else there.")
]
Model: TypeAlias = Annotated[
    str, typer.Option(help="An exported .onnx file; or rgb or depth, for those in the package.")
]
Threads: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Threads of one inference; all cores if not given.")
]
Provider: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="What runs the model: cpu, cuda, tensorrt, openvino, coreml, directml; or auto, for"
        " the first of them that starts.",
    ),
]
Strict: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--strict/--no-strict",
        help="Fail if --provider cannot be used, or let the processor take over with a warning.",
    ),
]
ScoreThreshold: TypeAlias = Annotated[
    float, typer.Option(min=0.0, max=1.0, help="Leave out trees with a lower score.")
]
Depth: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Depth image of an image, or folder with one of the same stem for each image:"
        " 16-bit PNG or TIFF in millimetres (or see --depth-scale), float TIFF or .npy in metres;"
        " 0 = no reading. With a depth model and without this, the image itself is taken for depth."
    ),
]
Camera: TypeAlias = Annotated[
    Path | None,
    typer.Option(metavar="FILE[:NAME]", help=f"Camera file, for metres. {CAMERA_FILES}"),
]
Up: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="Direction away from gravity in the camera's frame (x right, y down, z forward), as"
        " an IMU gives it; 0,-1,0 for a level camera. Without, the vertical of --mounting on a"
        " level machine is used, or else the ground's plane.",
    ),
]
Mounting: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File with the camera's place on its machine (x forward, y left, z up): cut points"
        " in the machine's frame too. Without --up, its vertical on a level machine is used."
    ),
]
DepthCamera: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE[:NAME]",
        help="Camera file of the depth, where another camera or lens took it; the depth is then"
        " moved into the image's pixels.",
    ),
]
DepthExtrinsics: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File with the transform from the depth camera's frame to the image camera's; the"
        " same frame if not given."
    ),
]
DepthScale: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="M_PER_UNIT|FILE",
        help="Metres of one unit of the depth files, 0.001 if not given; or the depth scale that"
        " `edgetree calibrate --depth` found.",
    ),
]
StumpHeight: TypeAlias = Annotated[
    float | None,
    typer.Option(metavar="M", help="Warn of felling cuts higher than this; 0.3 if not given."),
]
Csv: TypeAlias = Annotated[
    Path | None, typer.Option(help="File for a table, one row per tree, units in the names.")
]


@dataclass(frozen=True)
class RigOptions:
    """What the user said of cameras and depth, as options of those names."""

    camera: Path | None
    up: str | None
    mounting: Path | None
    depth_camera: Path | None
    depth_extrinsics: Path | None
    depth_scale: str | None
    stump_height: float | None

    def rig(self, depth: Path | None) -> Rig:
        """Read the files.

        Args:
            depth: where the depth images are; None if there are none beside the source.
        """
        from calib import load_transform
        from edgetree.errors import InputError
        from edgetree.frames.rig import Rig

        if depth is None and self.depth_camera is not None:
            raise InputError("--depth-camera given without --depth: expected the depth it took")
        depth_camera, moved, mounting = self.depth_camera, self.depth_extrinsics, self.mounting
        rig = Rig(
            camera=None if self.camera is None else _camera(self.camera),
            up_camera=None if self.up is None else _direction(self.up),
            mounting=None if mounting is None else load_transform(mounting),
            depth_camera=None if depth_camera is None else _camera(depth_camera),
            depth_extrinsics=None if moved is None else load_transform(moved),
        )
        return rig if self.depth_scale is None else _scaled(rig, self.depth_scale)

    def settings(self) -> MeasureSettings | None:
        """The settings of the measurement; None for the usual ones."""
        from edgetree.errors import InputError
        from edgetree.measure import MeasureSettings

        height_m = self.stump_height
        if height_m is None:
            return None
        if not (math.isfinite(height_m) and height_m > 0):
            raise InputError(f"--stump-height is {height_m}: expected metres, above 0")
        return MeasureSettings(max_stump_height_m=height_m)

    def check_paths(
        self,
        outputs: Mapping[str, Path | None],
        source: Path,
        depth: Path | None,
        model: str | None,
        mask: Path | None = None,
    ) -> None:
        """Refuse to write one path twice, or over what these options and the others read."""
        from edgetree.results.atomic_files import check_paths

        inputs = {
            "source": source,
            "--depth": depth,
            "--model": _named_file(model),
            "--mask": mask,
            "--camera": None if self.camera is None else _file_and_name(self.camera)[0],
            "--mounting": self.mounting,
            "--depth-camera": (
                None if self.depth_camera is None else _file_and_name(self.depth_camera)[0]
            ),
            "--depth-extrinsics": self.depth_extrinsics,
            "--depth-scale": _named_file(self.depth_scale),
        }
        check_paths(outputs, inputs)

    def words(self, depth: Path | None) -> str:
        """The same options again, to be typed."""
        given = {"depth": depth, **asdict(self)}
        return "".join(
            f" --{name.replace('_', '-')} {quoted(value)}"
            for name, value in given.items()
            if value is not None
        )


def quoted(value: object) -> str:
    """A value as a shell takes it."""
    return shlex.quote(str(value))


def _camera(file: Path) -> PinholeCamera:
    """The camera of a file, or of FILE:NAME."""
    from calib import load_camera

    path, name = _file_and_name(file)
    return load_camera(path, name=name)


def _named_file(text: str | None) -> Path | None:
    """The file that a value means, where it may be a number or a name of the package."""
    return None if text is None or not Path(text).is_file() else Path(text)


def _file_and_name(file: Path) -> tuple[Path, str | None]:
    path, colon, name = str(file).rpartition(":")
    if colon and not file.exists() and Path(path).is_file():
        return Path(path), name
    return file, None


def _scaled(rig: Rig, text: str) -> Rig:
    """The rig with a depth scale: a number, or the file of a calibration."""
    from calib import load_depth_scale

    try:
        return replace(rig, depth_scale_m=float(text))
    except ValueError:
        return replace(rig, depth_calibration=load_depth_scale(text))


def _direction(text: str) -> tuple[float, float, float]:
    from edgetree.errors import InputError
    from edgetree.measure.measure import unit_up

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--up is {text!r}: expected three numbers, such as 0,-1,0") from error
    unit_up((x, y, z))
    return x, y, z


def open_model(
    model: str,
    threads: int | None,
    score_threshold: float | None = None,
    *,
    provider: str = "cpu",
    strict: bool = True,
) -> tuple[TreeDetector, Path]:
    """The detector for the value of a `Model` option, and its file."""
    from edgetree.runtime.detector import DISPLAY_THRESHOLD, MODALITIES, TreeDetector, default_model

    path = default_model(model) if model in MODALITIES else Path(model)
    threshold = DISPLAY_THRESHOLD if score_threshold is None else score_threshold
    detector = TreeDetector.load(
        path,
        provider=provider,
        strict=strict,
        threads=threads,
        score_threshold=threshold,
    )
    return detector, path


def model_record(detector: TreeDetector, path: Path) -> dict[str, Any]:
    """Which model it was, JSON-ready."""
    manifest = detector.manifest
    return {
        "path": str(path),
        "name": manifest.name,
        "modality": manifest.modality,
        "precision": manifest.precision,
        "provider": detector.session.provider,
    }
