"""Dataclasses of options that several commands share."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from basetree.program.quoting import quoted
from edgetree.commands.options import (
    CAMERA,
    MODEL,
    DepthKind,
    DepthScale,
    Extrinsic,
    GroundCover,
    Mounting,
    Provider,
    ProviderCache,
    RigErrors,
    Rotate,
    SpeciesName,
    Strict,
    StumpHeight,
    Threads,
    Up,
    existing_file,
)
from edgetree.commands.reference_options import (
    CameraHeightText,
    GroundSlope,
    Horizon,
    MarkerText,
    Pitch,
    ScaleBarText,
    size_references,
    up_of_pitch,
)

if TYPE_CHECKING:
    from calib import PinholeCamera
    from calib.stereo import StereoPair
    from edgetree.frames.references import SizeReferences
    from edgetree.frames.rig import Rig
    from edgetree.measure import MeasureSettings, RigUncertainty
    from edgetree.report import ReportHead
    from edgetree.runtime.detector import TreeDetector


# Stumps and covers of the ground are no higher than this, m; larger numbers are of another unit.
_MOST_HEIGHT_M = 3.0


@dataclass(frozen=True)
class RigOptions:
    """The options about the cameras and the measurement, without --camera and --depth."""

    panel = CAMERA

    up: Up = None
    mounting: Mounting = None
    depth_camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE[:NAME]",
            help="Camera file of the depth, if another camera or lens took it. The depth is then"
            " aligned with the image.",
        ),
    ] = None
    depth_extrinsics: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File with the transform from the depth camera's frame to the image camera's.",
            show_default="the identity",
        ),
    ] = None
    extrinsic: Extrinsic = None
    depth_scale: DepthScale = None
    depth_kind: DepthKind = "depth"
    rotate: Rotate = None
    rig_errors: RigErrors = None
    stump_height: StumpHeight = None
    ground_cover: GroundCover = None
    species: SpeciesName = None
    camera_height: CameraHeightText = None
    ground_slope: GroundSlope = None
    pitch: Pitch = None
    horizon: Horizon = None
    marker: MarkerText = None
    scale_bar: ScaleBarText = None

    def rig(self, camera: Path | None, depth: Path | None) -> Rig:
        """Read the files.

        Args:
            camera: Value of --camera.
            depth: Value of --depth.

        Raises:
            InputError: Options contradict each other, or a value is invalid.
            InputError: a file cannot be read.
        """
        from basetree.errors import InputError
        from calib import load_transform
        from edgetree.frames.rig import Rig

        if depth is None and self.depth_camera is not None:
            raise InputError("--depth-camera given without --depth: expected both")
        references = self.references()
        if depth is not None and references is not None:
            raise InputError(
                "--depth given with an option for pictures without depth (--camera-height,"
                " --marker, --scale-bar or --horizon): expected one way to distances"
            )
        depth_camera, mounting = self.depth_camera, self.mounting
        extrinsics, cloud_extrinsics = self.depth_extrinsics, self.extrinsic
        rig = Rig(
            camera=None if camera is None else _load_camera(camera),
            up_camera=self._up(),
            mounting=None if mounting is None else load_transform(mounting),
            depth_camera=None if depth_camera is None else _load_camera(depth_camera),
            depth_extrinsics=None if extrinsics is None else load_transform(extrinsics),
            cloud_extrinsics=(
                None if cloud_extrinsics is None else load_transform(cloud_extrinsics)
            ),
            rotation_deg=self.rotate,
            uncertainty=_uncertainty(self.rig_errors),
            depth_kind=self.depth_kind,  # type: ignore[arg-type]  # checked by Rig
            references=references,
        )
        return rig if self.depth_scale is None else _scaled(rig, self.depth_scale)

    def rig_and_pair(
        self, camera: Path | None, depth: Path | None, right: str | None
    ) -> tuple[Rig, StereoPair | None]:
        """The rig, and the calibration of a stereo pair if its right pictures are given.

        Args:
            camera: Value of --camera; of a pair it names the calibration.
            depth: Value of --depth.
            right: The option that names these pictures, if one does.

        Raises:
            InputError: As for `rig`, or options do not fit a pair.
        """
        from basetree.errors import InputError
        from calib.files.stereo import load_stereo
        from edgetree.sources.stereo import stereo_rig

        if right is None:
            return self.rig(camera, depth), None
        if depth is not None:
            raise InputError(f"--depth given with {right}: expected only one of them")
        if camera is None:
            raise InputError(
                f"{right} given without --camera: expected the calibration of the stereo pair"
            )
        pair = load_stereo(camera)
        return stereo_rig(self.rig(None, None), pair), pair

    def references(self) -> SizeReferences | None:
        """What tells sizes without depth; None if nothing does.

        Raises:
            InputError: A value is invalid.
        """
        return size_references(
            self.camera_height, self.ground_slope, self.horizon, self.marker, self.scale_bar
        )

    def _up(self) -> tuple[float, float, float] | None:
        """The vertical by --up or --pitch."""
        from basetree.errors import InputError

        given = {"--up": self.up, "--pitch": self.pitch, "--horizon": self.horizon}
        names = [name for name, value in given.items() if value is not None]
        if len(names) > 1:
            raise InputError(f"{names[1]} given with {names[0]}: expected one of them")
        if self.up is not None:
            return _direction(self.up, self.rotate)
        return None if self.pitch is None else up_of_pitch(self.pitch, self.rotate)

    def settings(self) -> MeasureSettings | None:
        """The settings of the measurement; None for the defaults.

        Raises:
            InputError: --stump-height is out of range, --ground-cover is not two lengths, or
                --species is unknown.
        """
        from basetree.errors import InputError
        from edgetree.measure import SPECIES, MeasureSettings
        from edgetree.measure.volume import EXPECTED_SPECIES

        height_m = self.stump_height
        if height_m is None and self.species is None and self.ground_cover is None:
            return None
        if height_m is not None and not 0 < height_m <= _MOST_HEIGHT_M:
            raise InputError(
                f"--stump-height is {height_m:g}: expected metres above 0 and up to"
                f" {_MOST_HEIGHT_M:g}"
            )
        species = next((name for name in SPECIES if name == self.species), None)
        if species != self.species:
            raise InputError(f"--species is {self.species!r}: expected {EXPECTED_SPECIES}")
        settings = MeasureSettings(species=species)
        if self.ground_cover is not None:
            cover_m, std_m = _cover(self.ground_cover)
            settings = replace(settings, ground_cover_m=cover_m, ground_cover_std_m=std_m)
        return settings if height_m is None else replace(settings, max_stump_height_m=height_m)

    def files(self, camera: Path | None) -> dict[str, Path | None]:
        """The files that these options and --camera name, by option."""
        depth_camera = self.depth_camera
        return {
            "--camera": None if camera is None else _file_and_name(camera)[0],
            "--mounting": self.mounting,
            "--depth-camera": None if depth_camera is None else _file_and_name(depth_camera)[0],
            "--depth-extrinsics": self.depth_extrinsics,
            "--extrinsic": self.extrinsic,
            "--depth-scale": existing_file(self.depth_scale),
        }

    def names_in_files(self, camera: Path | None) -> dict[str, str | None]:
        """What is taken of the files that hold several cameras, by option."""
        return {
            option: None if file is None else _file_and_name(file)[1]
            for option, file in {"--camera": camera, "--depth-camera": self.depth_camera}.items()
        }

    def words(self, depth: Path | None, camera: Path | None) -> str:
        """These options, --depth and --camera as they would be typed on the command line."""
        given = {"depth": depth, "camera": camera, **asdict(self)}
        return "".join(
            f" --{name.replace('_', '-')} {quoted(value)}"
            for name, value in given.items()
            if value is not None and value != getattr(RigOptions, name, None)
        )


@dataclass(frozen=True)
class ReportOptions:
    """What the report says about itself, and the area for its basal area."""

    panel = "Report"

    title: Annotated[str | None, typer.Option(help="Heading of the report of --report.")] = None
    place: Annotated[
        str | None, typer.Option(help="Where the trees stand, for the report of --report.")
    ] = None
    area: Annotated[
        float | None,
        typer.Option(
            metavar="HA",
            help="Area in hectares that the trees stand on: the report of --report then has their"
            " basal area per hectare.",
        ),
    ] = None

    def head(self, report: Path | None) -> ReportHead:
        """The values for the report.

        Args:
            report: Value of --report.

        Raises:
            InputError: An option is given without --report, or the area is not above 0.
        """
        from basetree.errors import InputError
        from edgetree.report import ReportHead

        given = [name for name, value in vars(self).items() if value is not None]
        if given and report is None:
            raise InputError(f"--{given[0]} given without --report: expected both")
        if self.area is not None and not (math.isfinite(self.area) and self.area > 0):
            raise InputError(f"--area is {self.area}: expected hectares above 0")
        return ReportHead(self.title, self.place, self.area)


@dataclass(frozen=True)
class SessionOptions:
    """The options about running a model."""

    panel = MODEL

    threads: Threads = None
    provider: Provider = "cpu"
    strict: Strict = True
    provider_cache: ProviderCache = None

    def open_model(
        self, model: str, score_threshold: float | None = None
    ) -> tuple[TreeDetector, Path]:
        """Open the model of the option --model.

        Args:
            model: Name of a known model, or the path of an .onnx file.
            score_threshold: Lowest score of trees; None for the default.

        Returns:
            The detector and the path of the model file.

        Raises:
            EdgetreeError: As for `find_model` and `TreeDetector.load`.
        """
        from edgetree.catalogue import find_model
        from edgetree.runtime.detector import DISPLAY_THRESHOLD, TreeDetector

        path = find_model(model)
        threshold = DISPLAY_THRESHOLD if score_threshold is None else score_threshold
        return TreeDetector.load(path, score_threshold=threshold, **self.load_options()), path

    def load_options(self) -> dict[str, Any]:
        """The options by the names of `TreeDetector.load`."""
        return {
            "provider": self.provider,
            "strict": self.strict,
            "threads": self.threads,
            "cache_folder": self.provider_cache,
        }


def _cover(text: str) -> tuple[float, float]:
    """Height and standard deviation of a cover of the ground, from "M,STD"."""
    from basetree.errors import InputError

    try:
        height_m, std_m = (float(part) for part in text.split(","))
    except ValueError:
        height_m = std_m = math.nan
    if not (0 < height_m <= _MOST_HEIGHT_M and 0 < std_m <= _MOST_HEIGHT_M):
        raise InputError(
            f"--ground-cover is {text!r}: expected a height and its standard deviation in metres,"
            f" both above 0 and up to {_MOST_HEIGHT_M:g}, such as 0.3,0.05"
        )
    return height_m, std_m


def _uncertainty(text: str | None) -> RigUncertainty | None:
    from edgetree.measure import RigUncertainty

    return None if text is None else RigUncertainty.from_text(text)


def _load_camera(file: Path) -> PinholeCamera:
    """Load the camera from FILE or FILE:NAME."""
    from calib import load_camera

    path, name = _file_and_name(file)
    return load_camera(path, name=name)


def _file_and_name(file: Path) -> tuple[Path, str | None]:
    path, colon, name = str(file).rpartition(":")
    if colon and not file.exists() and Path(path).is_file():
        return Path(path), name
    return file, None


def _scaled(rig: Rig, text: str) -> Rig:
    """The rig with the value of --depth-scale: a number, or a file of a calibration."""
    from calib import load_depth_scale

    try:
        scale_m = float(text)
    except ValueError:
        return replace(rig, depth_calibration=load_depth_scale(text))
    return replace(rig, depth_scale_m=scale_m)


def _direction(text: str, rotation_deg: int | None) -> tuple[float, float, float]:
    from basetree.errors import InputError
    from edgetree.frames.turning import turn_of
    from edgetree.measure.inputs import unit_up

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--up is {text!r}: expected three numbers, such as 0,-1,0") from error
    try:
        unit_up(turn_of(rotation_deg, (x, y, z)).directions((x, y, z)))
    except InputError as error:
        raise InputError(f"--up is {text}: {error}") from error
    return x, y, z
