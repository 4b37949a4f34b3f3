"""`edgetree calibrate`: calibrate a camera from pictures of a printed board."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.counts import counted
from basetree.program.console import note, print_json, tell
from basetree.program.progress import track
from basetree.program.quoting import quoted
from edgetree.commands.options import Json

if TYPE_CHECKING:
    from calib.boards import (
        Board,
        BoardDetections,
        Calibration,
        CalibrationFailure,
        Dropped,
        Parameter,
        Picture,
    )
    from calib.depth_scale import DepthScale
    from calib.depth_scale_fit import DepthScaleFailure
    from edgetree.commands.frame_results import LeftOut
    from edgetree.sources.source import FrameSource

_Source: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        metavar="SOURCE...",
        help="A folder with pictures of the board, a video, pictures, or patterns such as"
        " 'board/*.png'.",
    ),
]
_Board: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="BOARD",
        help="The printed board: checkerboard:9x6:0.025 (inner corners, side of a square in"
        " metres); charuco:8x6:0.03:0.022:4x4_50 (squares, sides of square and marker in metres,"
        " dictionary; with :legacy at the end only the pattern of OpenCV before 4.6);"
        " aprilgrid:6x6:0.088:0.3 (tags, side of a tag in metres, space between tags as a share of"
        " it); circles:7x5:0.02 or circles:4x11:0.02:asymmetric (circles per row x rows,"
        " metres between rows).",
    ),
]
_Lens: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="NAME", help="Lens model: radtan, or fisheye for fields of view from 120 degrees."
    ),
]
_Out: TypeAlias = Annotated[Path, typer.Option(help="The camera file (JSON) to write.")]
_Depth: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Folder with a depth image of the same name for each picture. The scale and offset of"
        " the depth are then estimated too, and written next to the camera file."
    ),
]


def calibrate(
    source: _Source,
    board: _Board,
    model: _Lens = "radtan",
    out: _Out = Path("camera.json"),
    depth: _Depth = None,
    as_json: Json = False,
) -> None:
    """Estimate a camera's focal length, centre and distortion with their standard deviations.

    If the calibration is not accurate enough for measuring, no file is written and the exit code
    is 1. Pictures of a folder that cannot be read are left out, with exit code 1 too.
    """
    from basetree.errors import InputError
    from basetree.files.writing import output_folder
    from calib.boards import LENS_MODELS, parse_board
    from edgetree.commands.frame_results import LeftOut
    from edgetree.sources.several import open_pictures
    from edgetree.sources.source_list import list_sources

    if model not in LENS_MODELS:
        raise InputError(f"--model is {model!r}: expected {' or '.join(LENS_MODELS)}")
    if out.is_dir():
        raise InputError(f"{out} is a folder: expected the name of a file to write")
    if out.suffix.lower() != ".json":
        raise InputError(f"--out is {out}: expected a file name ending in .json")
    printed_board, sources = parse_board(board), list_sources(source)
    frames = open_pictures(sources, upright=False)
    depth_frames = None if depth is None else open_pictures(sources, depth)
    left_out = LeftOut(strict=sources.one is not None and not sources.one.is_dir())
    with output_folder(out.parent):
        outcome = _solve(frames, depth_frames, printed_board, model, left_out)
        written = outcome.write(out)
        if as_json:
            options = {"source": str(sources.one or sources.name), "board": board, "model": model}
            record = {**options, **outcome.record(), **written}
            record |= {"left_out": left_out.reasons} if left_out.reasons else {}
            print_json({"schema": "edgetree.calibrate/1", **record})
        else:
            for line in outcome.lines():
                tell(line)
        for path in written.values():
            if path is not None:
                note(f"written: {path}")
        outcome.check()
    left_out.check_none(outcome.sightings.pictures)
    scale = written["depth_scale_file"]
    scale_option = "" if scale is None else f" --depth-scale {quoted(scale)}"
    note(
        f"next: edgetree measure IMAGE --depth DEPTH --camera {quoted(out)}{scale_option}",
        whole=True,
    )


@dataclass(frozen=True)
class _Outcome:
    """The results; `depth` is None if it was not requested or the camera was not calibrated."""

    sightings: BoardDetections
    result: Calibration | CalibrationFailure
    depth: DepthScale | DepthScaleFailure | None
    side_m: float

    def advice(self) -> list[str]:
        """What would make the results better, or is to be looked at."""
        from calib.scale_limits import tell_scale

        told = None
        if self.depth:
            told = tell_scale(self.depth.scale, self.depth.scale_std, self.side_m)[1]
        return [*([told] if told else []), *self.result.advice]

    def write(self, out: Path) -> dict[str, str | None]:
        """Write the files that are accurate enough; returns their paths by JSON key."""
        from calib import save_camera, save_depth_scale

        written: dict[str, str | None] = {"camera_file": None, "depth_scale_file": None}
        if self.result and self.result.passed:
            save_camera(out, self.result.camera)
            written["camera_file"] = str(out)
            if self.depth:
                scale_file = out.with_suffix(".depth_scale.json")
                save_depth_scale(scale_file, self.depth)
                written["depth_scale_file"] = str(scale_file)
        return written

    def check(self) -> None:
        """Raise CheckFailed if a result is not accurate enough."""
        from basetree.errors import CheckFailed
        from calib import DepthScaleFailure
        from calib.boards import CalibrationFailure

        if isinstance(self.result, CalibrationFailure):
            raise CheckFailed(self.result.reason)
        reasons = list(self.result.reasons)
        if isinstance(self.depth, DepthScaleFailure):
            reasons.append(f"no depth scale: {self.depth.reason}")
        if reasons:
            raise CheckFailed("; ".join(reasons))

    def record(self) -> dict[str, Any]:
        """The results as a JSON object."""
        from calib import DepthScaleFailure

        seen = self.sightings
        depth = self.depth
        return {
            "pictures": seen.pictures,
            "without_board": list(seen.without_board),
            "repeated": list(seen.repeated),
            "seen_in_part": dict(seen.seen_in_part),
            **self.result.to_dict(),
            "advice": self.advice(),
            "depth_scale": depth.to_dict() if depth else None,
            "depth_failure": depth.reason if isinstance(depth, DepthScaleFailure) else None,
        }

    def lines(self) -> Iterator[str]:
        """The results as text."""
        seen = self.sightings
        shown = (
            f"{len(seen.views)} of {counted(seen.pictures, 'picture')} show the board in a"
            " new position"
        )
        yield f"{shown}, {seen.width}x{seen.height} px"
        for name, part in seen.seen_in_part.items():
            yield f"{name} shows {part}"
        if not seen.views and seen.seen_in_part:
            yield "markers but no board found: check the numbers of squares or tags, the dictionary"
            yield "and the sides that --board gives"
        elif not seen.views:
            yield "no board found: give the number of inner corners of a checkerboard, of squares"
            yield "of a ChArUco board, of circles per row and of rows of a circle board"
        elif seen.without_board:
            yield f"no board found in {', '.join(seen.without_board)}"
        if seen.repeated:
            yield f"no new position in {', '.join(seen.repeated)}"
        if self.result:
            yield from _camera_lines(self.result)
        else:
            yield from (_dropped_line(dropped) for dropped in self.result.dropped)
        if self.depth:
            yield from _depth_lines(self.depth)
        yield from (f"advice: {advice}" for advice in self.advice())


def _solve(
    frames: FrameSource,
    depth_frames: FrameSource | None,
    board: Board,
    model: str,
    left_out: LeftOut,
) -> _Outcome:
    from calib.boards import calibrate_camera, find_boards

    seen = find_boards(_pictures(frames, left_out), board)
    left_out.check_some(seen.pictures)
    result = calibrate_camera(seen.views, (seen.width, seen.height), model)
    depth = None
    if depth_frames is not None and result:
        depth = _depth_scale(depth_frames, seen, result, board.side_m, left_out)
    return _Outcome(seen, result, depth, board.side_m)


def _pictures(frames: FrameSource, left_out: LeftOut) -> Iterator[Picture]:
    import cv2
    import numpy as np

    from basetree.errors import InputError
    from calib.boards import Picture
    from edgetree.sources.source import readable

    for frame in track(readable(frames, left_out.add), "looking for the board", frames.count):
        try:
            grey = cv2.cvtColor(frame.picture(), cv2.COLOR_BGR2GRAY)
        except InputError as error:
            left_out.add(error)
            continue
        yield Picture(frame.name, np.asarray(grey, np.uint8), frame.time_s)


def _depth_scale(
    frames: FrameSource,
    seen: BoardDetections,
    result: Calibration,
    side_m: float,
    left_out: LeftOut,
) -> DepthScale | DepthScaleFailure:
    from calib import fit_depth_scale, read_target
    from edgetree.sources.source import readable

    points_px = {view.name: view.image_px for view in seen.views}
    poses = {view.name: view.pose for view in result.views}
    return fit_depth_scale(
        [
            read_target(
                frame.name, result.camera, poses[frame.name], points_px[frame.name], frame.depth_m
            )
            for frame in track(readable(frames, left_out.add_once), "reading depth", frames.count)
            if frame.name in poses and frame.depth_m is not None
        ],
        side_m,
    )


def _camera_lines(result: Calibration) -> Iterator[str]:
    width = max(4, *(len(view.name) for view in result.views))
    yield f"{'view':{width}}  points  rms px  worst px  distance m  tilt deg"
    for view in result.views:
        yield (
            f"{view.name:{width}}  {view.points:6}  {view.rms_px:6.2f}  {view.worst_px:8.2f}"
            f"  {view.distance_m:10.2f}  {view.tilt_deg:8.0f}"
        )
    yield from (_dropped_line(dropped) for dropped in result.dropped)
    yield from (_parameter_line(parameter) for parameter in result.parameters)
    yield f"RMS reprojection error {result.rms_px:.2f} px in {counted(len(result.views), 'view')}"
    yield f"{result.coverage.share:.0%} of the image area covered; views per cell of a grid:"
    yield from (f"  {row}" for row in result.coverage.text())


def _dropped_line(dropped: Dropped) -> str:
    points = dropped.points
    listed = f"point{'s' * (len(points) > 1)} {', '.join(map(str, points))}"
    what = f"{listed} of {dropped.view}" if points else dropped.view
    return f"left out {what}: {dropped.reason}"


def _parameter_line(parameter: Parameter) -> str:
    return (
        f"{parameter.name:3}{_with_std(parameter.value, parameter.std)} {parameter.unit}".rstrip()
    )


def _with_std(value: float, std: float) -> str:
    """A value and its standard deviation, rounded to the latter's second digit."""
    decimals = max(0, 1 - math.floor(math.log10(std))) if std > 0 else 6
    return f"{value:10.{decimals}f} ± {std:.{decimals}f}"


def _depth_lines(depth: DepthScale) -> Iterator[str]:
    scale, offset = (
        _with_std(depth.scale, depth.scale_std).strip(),
        _with_std(1000 * depth.offset_m, 1000 * depth.offset_std_m).strip(),
    )
    yield f"depth: true = ({scale}) x reading + ({offset}) mm"
    yield "  targets: distance in m (residual in mm, standard deviation of readings in mm)"
    for target in sorted(depth.targets, key=lambda each: each.distance_m):
        off, scatter = 1000 * target.residual_m, 1000 * target.noise_std_m
        yield f"  {target.distance_m:6.2f} ({off:+.1f}, {scatter:.1f}) {target.name}"
    yield from (f"  left out {name}" for name in depth.dropped)
