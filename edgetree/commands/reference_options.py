"""Options that tell sizes in pictures without depth, and what their texts mean."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

if TYPE_CHECKING:
    from edgetree.frames.references import ScaleBar, SizeReferences
    from edgetree.measure import CameraHeight

_WITHOUT_DEPTH: Final = "Sizes without depth"

CameraHeightText: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="M[:STD]",
        help="Without depth: height of the camera above the ground, with its standard deviation if"
        " known, such as 2.4:0.05. The foot of a stem in the picture then tells its distance.",
        rich_help_panel=_WITHOUT_DEPTH,
    ),
]
GroundSlope: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="DEG[,DEG][:STD]",
        help="With --camera-height: slope of the ground ahead of the camera, and to its right,"
        " positive where it rises, with the standard deviation, such as 8,-3:2.",
        show_default="level within 3 degrees",
        rich_help_panel=_WITHOUT_DEPTH,
    ),
]
Pitch: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help="In place of --up: how far the camera looks down, in degrees, if it is not tilted to a"
        " side; of one that is mounted on its side or upside down with --rotate.",
        rich_help_panel=_WITHOUT_DEPTH,
    ),
]
Horizon: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,X,Y",
        help="In place of --up: two points of the picture on the horizon, in pixels.",
        rich_help_panel=_WITHOUT_DEPTH,
    ),
]
MarkerText: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="aruco:DICT:ID:SIZE",
        help="Without depth: a marker on or beside the stems, with the side of its black square in"
        " metres, such as aruco:4x4_50:7:0.16.",
        rich_help_panel=_WITHOUT_DEPTH,
    ),
]
ScaleBarText: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,X,Y,M",
        help="Without depth: two points of the picture on or beside a stem, in pixels, and the"
        " metres between them.",
        rich_help_panel=_WITHOUT_DEPTH,
    ),
]


def size_references(
    camera_height: str | None,
    ground_slope: str | None,
    horizon: str | None,
    marker: str | None,
    scale_bar: str | None,
) -> SizeReferences | None:
    """What the options tell; None if none of them is given.

    Raises:
        InputError: A text has another form, or a value is out of range.
    """
    from basetree.errors import InputError
    from calib.boards import parse_marker
    from edgetree.frames.references import SizeReferences

    if ground_slope is not None and camera_height is None:
        raise InputError("--ground-slope given without --camera-height: expected both")
    height = None if camera_height is None else _camera_height(camera_height, ground_slope)
    bar = None if scale_bar is None else _scale_bar(scale_bar)
    found = SizeReferences(
        height,
        None if marker is None else parse_marker(marker),
        bar,
        None if horizon is None else _four(horizon),
    )
    return None if found == SizeReferences() else found


def up_of_pitch(pitch_deg: float, rotation_deg: int | None) -> tuple[float, float, float]:
    """The vertical in the frame of a camera that looks down by some degrees.

    Args:
        pitch_deg: How far it looks down.
        rotation_deg: By how much its pictures must be turned to be upright; None for not at all.

    Raises:
        InputError: It is not between -60 and 60.
    """
    from basetree.errors import InputError
    from edgetree.frames.turning import turn_of

    if not abs(pitch_deg) <= 60:
        raise InputError(f"--pitch is {pitch_deg}: expected degrees from -60 to 60")
    angle = math.radians(pitch_deg)
    upright = (0.0, -math.cos(angle), -math.sin(angle))
    x, y, z = turn_of(rotation_deg, None).back.directions(upright).tolist()
    return x, y, z


def _camera_height(text: str, slope: str | None) -> CameraHeight:
    from basetree.errors import InputError
    from edgetree.measure import CameraHeight

    value, std_m = _with_std("--camera-height", text, "metres such as 2.4 or 2.4:0.05")
    if len(value) != 1:
        raise InputError(f"--camera-height is {text!r}: expected metres such as 2.4 or 2.4:0.05")
    try:
        if slope is None:
            return CameraHeight(value[0], std_m)
        expected = "degrees such as 8, 8,-3 or 8,-3:2"
        parts, std_deg = _with_std("--ground-slope", slope, expected)
        if len(parts) > 2:
            raise InputError(f"--ground-slope is {slope!r}: expected {expected}")
        ahead, right = (*parts, 0.0)[:2]
        if std_deg is None:
            return CameraHeight(value[0], std_m, ahead, right)
        return CameraHeight(value[0], std_m, ahead, right, std_deg)
    except InputError as error:
        given = f"--camera-height {text}" + ("" if slope is None else f" --ground-slope {slope}")
        raise InputError(f"{given}: {error}") from error


def _with_std(name: str, text: str, expected: str) -> tuple[list[float], float | None]:
    """Numbers with commas between them, and what follows a colon."""
    from basetree.errors import InputError

    values, colon, std = text.partition(":")
    try:
        numbers = [float(part) for part in values.split(",")]
        deviation = float(std) if colon else None
    except ValueError as error:
        raise InputError(f"{name} is {text!r}: expected {expected}") from error
    if not all(map(math.isfinite, (*numbers, deviation or 0.0))):
        raise InputError(f"{name} is {text!r}: expected {expected}")
    return numbers, deviation


def _four(text: str) -> tuple[float, float, float, float]:
    from basetree.errors import InputError

    expected = "two points X,Y,X,Y in pixels, such as 0,310,1280,322"
    numbers, std = _with_std("--horizon", text, expected)
    if len(numbers) != 4 or std is not None:
        raise InputError(f"--horizon is {text!r}: expected {expected}")
    return numbers[0], numbers[1], numbers[2], numbers[3]


def _scale_bar(text: str) -> ScaleBar:
    from basetree.errors import InputError
    from edgetree.frames.references import ScaleBar

    expected = "two points and metres X,Y,X,Y,M, such as 410,200,412,396,1.0"
    numbers, std = _with_std("--scale-bar", text, expected)
    if len(numbers) != 5 or std is not None or numbers[4] <= 0 or numbers[:2] == numbers[2:4]:
        raise InputError(f"--scale-bar is {text!r}: expected {expected}")
    return ScaleBar((numbers[0], numbers[1], numbers[2], numbers[3]), numbers[4])
