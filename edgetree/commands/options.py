"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from basetree.program.talking import GENERAL

if TYPE_CHECKING:
    from edgetree.runtime.detector import TreeDetector

INPUT: Final = "Input"
CAMERA: Final = "Camera and depth"
MEASURING: Final = "Measuring"
MODEL: Final = "Model"
RESULTS: Final = "Results"
"""Groups of options in the help."""

CAMERA_FILES = (
    "Formats: calib.camera/1 JSON of this project, ROS, OpenCV, Kalibr, CamOdoCal, ORB-SLAM,"
    " RealSense, ZED, DepthAI, Record3D. NAME selects one of several cameras in a file."
)

Json: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Print one JSON object on stdout and nothing else.",
        rich_help_panel=GENERAL,
    ),
]


def _model_names() -> list[str]:
    """The names that --model takes, for completion."""
    from edgetree.catalogue import known_models

    return [model.name for model in known_models()]


Model: TypeAlias = Annotated[
    str,
    typer.Option(
        autocompletion=_model_names,
        metavar="NAME|FILE",
        help="An exported .onnx file, or the name of a model that `edgetree models` lists; rgb and"
        " depth are the defaults of the package.",
        rich_help_panel=MODEL,
    ),
]
ModelByInput: TypeAlias = Annotated[
    str | None,
    typer.Option(
        autocompletion=_model_names,
        metavar="NAME|FILE",
        help="An exported .onnx file, or the name of a model that `edgetree models` lists.",
        show_default="depth where the source has depth or an option such as --depth gives it, else"
        " rgb",
        rich_help_panel=MODEL,
    ),
]
Threads: TypeAlias = Annotated[
    int | None,
    typer.Option(
        min=1, help="Threads of one inference.", show_default="all cores", rich_help_panel=MODEL
    ),
]
Provider: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="What runs the model: cpu, cuda, tensorrt, openvino, coreml or directml; or auto for"
        " the first of cuda, coreml, directml, openvino and cpu that starts.",
    ),
]
ProviderCache: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Folder where TensorRT, OpenVINO or CoreML keep what they have compiled of the model,"
        " so that it starts faster the next time; it is made if needed.",
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
    float,
    typer.Option(
        min=0.0, max=1.0, help="Leave out trees with a lower score.", rich_help_panel=MODEL
    ),
]
Depth: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Depth image of an image, or folder with the depth images of a folder of images, by"
        " their names: PNG, TIFF or .npy, integers in millimetres or floating point in metres (or"
        " see --depth-scale); 0 = no reading.",
        show_default="with a depth model the image itself",
        rich_help_panel=INPUT,
    ),
]
Right: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="PATH",
        help="Picture of the right camera of a stereo pair, or the folder or video of the right"
        " pictures, in the same order. Depth comes from both. --camera then names the calibration"
        " of the pair: calib.stereo/1 JSON, Kalibr camchain, OpenCV (M1, D1, M2, D2, R, T) or KITTI"
        " calib.txt.",
        rich_help_panel=INPUT,
    ),
]
Cloud: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Point cloud of a laser scanner for an image, or folder with those of a folder of"
        " images, by their names: PLY, PCD, LAS, LAZ, NPZ or KITTI's BIN, in metres. It is"
        " projected into the picture, which needs --camera and --extrinsic.",
        rich_help_panel=INPUT,
    ),
]
Extrinsic: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File with the transform from the scanner's frame to the image camera's (x right,"
        " y down, z forward), for point clouds."
    ),
]
DepthScale: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="M_PER_UNIT|FILE",
        help="Metres per unit of the depth, or a depth scale file of `edgetree calibrate --depth`.",
        show_default="0.001 for integers, 1 for floating point",
    ),
]
DepthKind: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="depth|range",
        help="Whether the depth is along the optical axis, or along the ray of each pixel as some"
        " lidars and time-of-flight cameras give it, which needs the camera.",
    ),
]
Rotate: TypeAlias = Annotated[
    int | None,
    typer.Option(
        metavar="0|90|180|270",
        help="Degrees by which pictures must be turned clockwise to be upright, for a camera that"
        " is mounted on its side or upside down. Depth, masks, camera, --up and --mounting are"
        " turned with them, and results are given in the pictures as they are.",
        show_default="by the vertical, where it tells a camera on its side",
    ),
]
Camera: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE[:NAME]",
        help=f"Camera file, needed for measuring. {CAMERA_FILES}",
        rich_help_panel=CAMERA,
    ),
]
Up: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="Direction opposite to gravity in the camera's frame (x right, y down, z forward), as"
        " from an IMU; 0,-1,0 for a level camera.",
        show_default="that of a level machine with --mounting, else estimated from the stems, the"
        " ground and the camera",
    ),
]
Mounting: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="File with the transform from the camera's frame to the machine's (x forward, y left,"
        " z up). Cut points are then given in the machine's frame too."
    ),
]
RigErrors: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="NAME=VALUE,...",
        help="How well the rig is known, as standard deviations: scale of the depth (a share),"
        " principal point (px), vertical and mounting (degrees), offset of all depth (m), such"
        " as scale=0.004,principal=1.2,vertical=0.5,mounting=1,offset=0.02. They are part of all"
        " intervals. What is not given is taken from the files of camera and depth scale, or else"
        " assumed.",
    ),
]
StumpHeight: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Warn of felling cuts higher than this, in metres.",
        show_default="0.3",
        rich_help_panel=MEASURING,
    ),
]
GroundCover: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="M,STD",
        help="Height of snow, moss or plants with an even top that hide the ground, and its"
        " standard deviation, in metres as measured by hand, such as 0.3,0.05. Heights then count"
        " from the ground below.",
        rich_help_panel=MEASURING,
    ),
]
SpeciesName: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Species of the trees, for the volume of whole stems: pine, spruce or birch.",
        rich_help_panel=MEASURING,
    ),
]
Csv: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.csv",
        help="CSV file to write, one row per tree, units in column names.",
        rich_help_panel=RESULTS,
    ),
]
Profiles: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.csv",
        help="CSV file to write, one row per tree and height with the diameter there.",
        rich_help_panel=RESULTS,
    ),
]
Report: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.html",
        help="Report to write: one HTML page with the pictures, all trees and diameter classes.",
        rich_help_panel=RESULTS,
    ),
]


def existing_file(text: str | None) -> Path | None:
    """The value as a path, if it is an existing file; it may also be a number or a name."""
    return None if text is None or not Path(text).is_file() else Path(text)


def check_distances(
    depth: Path | None, right: Path | None, cloud: Path | None, *, without_depth: bool
) -> None:
    """Raise InputError if more than one option says where distances come from.

    Args:
        depth: Value of --depth.
        right: Value of --right.
        cloud: Value of --cloud, which is to hold point clouds.
        without_depth: Whether an option is given that tells sizes without depth.
    """
    from basetree.errors import InputError

    given = {"--depth": depth, "--right": right, "--cloud": cloud}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"{named[1]} given with {named[0]}: expected one of them")
    if named and without_depth:
        raise InputError(
            f"{named[0]} given with an option for pictures without depth (--camera-height,"
            " --marker, --scale-bar or --horizon): expected one way to distances"
        )
    if cloud is not None:
        _check_clouds(cloud)


def _check_clouds(path: Path) -> None:
    from basetree.errors import InputError
    from calib.clouds import CLOUD_SUFFIXES, is_cloud_file

    expected = f"expected a point cloud ({', '.join(CLOUD_SUFFIXES)})"
    if path.is_dir():
        if not any(is_cloud_file(each) for each in path.rglob("*")):
            raise InputError(f"cloud {path} is a folder without clouds: {expected}")
    elif not path.exists():
        raise InputError(f"cloud {path} does not exist: {expected}, or a folder of them")
    elif not is_cloud_file(path):
        raise InputError(f"cloud {path} is of another kind: {expected}")


def check_extrinsic(extrinsic: Path | None, *others: Path | None) -> None:
    """Raise InputError if --extrinsic is given and none of the other paths may hold clouds."""
    from basetree.errors import InputError
    from calib.clouds import is_cloud_file

    if extrinsic is not None and not any(
        path is not None and (path.is_dir() or is_cloud_file(path)) for path in others
    ):
        raise InputError("--extrinsic given without --cloud: expected both")


def check_report(path: Path | None) -> None:
    """Raise InputError if the value of --report is not the name of an HTML file."""
    from basetree.errors import InputError

    if path is not None and path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--report is {path}: expected a file name ending in .html")


def model_words(detector: TreeDetector, path: Path) -> str:
    """What a model is, for a note."""
    manifest = detector.manifest
    images = manifest.images
    trained = manifest.training_data or "unknown data"
    return f"model: {path.name}, {manifest.precision} for {images} images, trained on {trained}"


def model_file(model: str | None) -> Path | None:
    """The file of the option --model; None for a packaged model."""
    return existing_file(model)


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
