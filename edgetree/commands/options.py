"""Options that several commands share."""

from __future__ import annotations

import math
import shlex
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
    "SessionOptions",
    "Strict",
    "StumpHeight",
    "Threads",
    "Up",
    "model_file",
    "model_record",
    "quoted",
]

CAMERA_FILES = (
    "Formats: calib.camera/1 JSON of this project, ROS, OpenCV, Kalibr, CamOdoCal, RealSense, ZED."
    " NAME selects one of several cameras in a file."
)

Json: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else.")
]
Model: TypeAlias = Annotated[
    str, typer.Option(help="An exported .onnx file, or the packaged model rgb or depth.")
]
Threads: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Threads of one inference; all cores if not given.")
]
Provider: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="What runs the model: cpu, cuda, tensorrt, openvino, coreml or directml; or auto for"
        " the first of cuda, coreml, directml, openvino and cpu that starts.",
    ),
]
Strict: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--strict/--no-strict",
        help="If --provider cannot be used, fail, or use the CPU with a warning.",
    ),
]
ScoreThreshold: TypeAlias = Annotated[
    float, typer.Option(min=0.0, max=1.0, help="Leave out trees with a lower score.")
]
Depth: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Depth image of an image, or folder with a depth image of the same stem for each"
        " image: 16-bit PNG or TIFF in millimetres (or see --depth-scale), float TIFF or .npy in"
        " metres; 0 = no reading. If not given, a depth model reads the image itself as depth."
    ),
]
Camera: TypeAlias = Annotated[
    Path | None,
    typer.Option(metavar="FILE[:NAME]", help=f"Camera file, needed for measuring. {CAMERA_FILES}"),
]
Up: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="Direction opposite to gravity in the camera's frame (x right, y down, z forward), as"
        " from an IMU; 0,-1,0 for a level camera. If not given: the vertical of a level machine"
        " with --mounting, otherwise the normal of the ground.",
    ),
]
Mounting: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File with the transform from the camera's frame to the machine's (x forward, y left,"
        " z up). Cut points are then given in the machine's frame too."
    ),
]
DepthCamera: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE[:NAME]",
        help="Camera file of the depth, if another camera or lens took it. The depth is then"
        " aligned with the image.",
    ),
]
DepthExtrinsics: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File with the transform from the depth camera's frame to the image camera's; the"
        " identity if not given."
    ),
]
DepthScale: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="M_PER_UNIT|FILE",
        help="Metres per unit of the depth files, 0.001 if not given; or a depth scale file of"
        " `edgetree calibrate --depth`.",
    ),
]
StumpHeight: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="M", help="Warn of felling cuts higher than this, in metres; 0.3 if not given."
    ),
]
Csv: TypeAlias = Annotated[
    Path | None, typer.Option(help="CSV file to write, one row per tree, units in column names.")
]


@dataclass(frozen=True)
class RigOptions:
    """The options about the cameras and the measurement, without --camera and --depth."""

    up: Up = None
    mounting: Mounting = None
    depth_camera: DepthCamera = None
    depth_extrinsics: DepthExtrinsics = None
    depth_scale: DepthScale = None
    stump_height: StumpHeight = None

    def rig(self, camera: Path | None, depth: Path | None) -> Rig:
        """Read the files.

        Args:
            camera: value of --camera.
            depth: value of --depth.

        Raises:
            InputError: options contradict each other, or a value is invalid.
            CalibError: a file cannot be read.
        """
        from calib import load_transform
        from edgetree.errors import InputError
        from edgetree.frames.rig import Rig

        if depth is None and self.depth_camera is not None:
            raise InputError("--depth-camera given without --depth: expected both")
        depth_camera, mounting = self.depth_camera, self.mounting
        extrinsics = self.depth_extrinsics
        rig = Rig(
            camera=None if camera is None else _load_camera(camera),
            up_camera=None if self.up is None else _direction(self.up),
            mounting=None if mounting is None else load_transform(mounting),
            depth_camera=None if depth_camera is None else _load_camera(depth_camera),
            depth_extrinsics=None if extrinsics is None else load_transform(extrinsics),
        )
        return rig if self.depth_scale is None else _scaled(rig, self.depth_scale)

    def settings(self) -> MeasureSettings | None:
        """The settings of the measurement; None for the defaults.

        Raises:
            InputError: --stump-height is not positive.
        """
        from edgetree.errors import InputError
        from edgetree.measure import MeasureSettings

        height_m = self.stump_height
        if height_m is None:
            return None
        if not (math.isfinite(height_m) and height_m > 0):
            raise InputError(f"--stump-height is {height_m}: expected metres above 0")
        return MeasureSettings(max_stump_height_m=height_m)

    def files(self, camera: Path | None) -> dict[str, Path | None]:
        """The files that these options and --camera name, by option."""
        depth_camera = self.depth_camera
        return {
            "--camera": None if camera is None else _file_and_name(camera)[0],
            "--mounting": self.mounting,
            "--depth-camera": None if depth_camera is None else _file_and_name(depth_camera)[0],
            "--depth-extrinsics": self.depth_extrinsics,
            "--depth-scale": _existing_file(self.depth_scale),
        }

    def words(self, depth: Path | None, camera: Path | None) -> str:
        """These options, --depth and --camera as they would be typed on the command line."""
        given = {"depth": depth, "camera": camera, **asdict(self)}
        return "".join(
            f" --{name.replace('_', '-')} {quoted(value)}"
            for name, value in given.items()
            if value is not None
        )


@dataclass(frozen=True)
class SessionOptions:
    """The options about running a model."""

    threads: Threads = None
    provider: Provider = "cpu"
    strict: Strict = True

    def open_model(
        self, model: str, score_threshold: float | None = None
    ) -> tuple[TreeDetector, Path]:
        """Open the model of the option --model.

        Args:
            model: "rgb", "depth" or the path of an .onnx file.
            score_threshold: lowest score of trees; None for the default.

        Returns:
            The detector and the path of the model file.

        Raises:
            EdgetreeError: as for `TreeDetector.load`.
        """
        from edgetree.runtime.detector import (
            DISPLAY_THRESHOLD,
            MODALITIES,
            TreeDetector,
            default_model,
        )

        path = default_model(model) if model in MODALITIES else Path(model)
        detector = TreeDetector.load(
            path,
            provider=self.provider,
            strict=self.strict,
            threads=self.threads,
            score_threshold=DISPLAY_THRESHOLD if score_threshold is None else score_threshold,
        )
        return detector, path


def quoted(value: object) -> str:
    """A value quoted for the shell."""
    return shlex.quote(str(value))


def _load_camera(file: Path) -> PinholeCamera:
    """Load the camera from FILE or FILE:NAME."""
    from calib import load_camera

    path, name = _file_and_name(file)
    return load_camera(path, name=name)


def model_file(model: str | None) -> Path | None:
    """The file of the option --model; None for a packaged model."""
    return _existing_file(model)


def _existing_file(text: str | None) -> Path | None:
    """The value as a path, if it is an existing file; it may also be a number or a name."""
    return None if text is None or not Path(text).is_file() else Path(text)


def _file_and_name(file: Path) -> tuple[Path, str | None]:
    path, colon, name = str(file).rpartition(":")
    if colon and not file.exists() and Path(path).is_file():
        return Path(path), name
    return file, None


def _scaled(rig: Rig, text: str) -> Rig:
    """The rig with the value of --depth-scale: a number, or a file of a calibration."""
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


def model_record(detector: TreeDetector, path: Path) -> dict[str, Any]:
    """The model as a JSON object."""
    manifest = detector.manifest
    return {
        "path": str(path),
        "name": manifest.name,
        "modality": manifest.modality,
        "precision": manifest.precision,
        "provider": detector.session.provider,
    }
