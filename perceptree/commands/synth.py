"""`perceptree synth`: simulate a labelled dataset."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.errors import SettingsError
from basetree.program.console import note
from basetree.program.options import expand_groups
from basetree.program.progress import counter
from perceptree.commands.options import Json
from perceptree.commands.shards import ShareOptions, print_shard
from perceptree.commands.synth_result import print_result

if TYPE_CHECKING:
    from perceptree.simulator import SimulatorSettings
    from perceptree.simulator.dataset.shards import SynthJob
    from perceptree.simulator.photographs.folder import PhotoFolder
    from perceptree.simulator.settings.presets import Preset

_LABEL = "simulating"


@dataclass(frozen=True)
class DatasetOptions:
    """Which dataset is simulated."""

    panel = "Dataset"

    frames: Annotated[
        int | None,
        typer.Option(
            help="Number of frames; a larger number extends a dataset.",
            show_default="400; with --preset the preset's",
        ),
    ] = None
    seed: Annotated[
        int | None,
        typer.Option(help="Seed of the simulation.", show_default="0; with --preset the preset's"),
    ] = None
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Preset: paper, field, vegetation, drive, plain, test, field-test.",
            show_default="the conditions of field",
        ),
    ] = None
    settings: Annotated[
        Path | None,
        typer.Option(help="JSON file with changed settings, in the form of settings.json."),
    ] = None


@dataclass(frozen=True)
class PictureOptions:
    """Changes of the camera, the pictures and the labels."""

    panel = "Camera, pictures and labels"

    width: Annotated[int | None, typer.Option(help="Image width, px.", show_default="1280")] = None
    height: Annotated[int | None, typer.Option(help="Image height, px.", show_default="720")] = None
    camera: Annotated[
        Path | None, typer.Option(help="Camera file with intrinsics and distortion.")
    ] = None
    views: Annotated[
        int | None, typer.Option(help="Frames per scene.", show_default="the preset's, of field 4")
    ] = None
    reach: Annotated[
        float | None,
        typer.Option(
            help="Label trees up to this distance in metres, at most 13.", show_default="10"
        ),
    ] = None
    image_format: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Colour images as jpg or png.", show_default="jpg"),
    ] = None
    textures: Annotated[
        Path | None,
        typer.Option(help="Folder of photographs of bark, ground, stones, leaves, far stands."),
    ] = None

    def changed(self, settings: SimulatorSettings) -> SimulatorSettings:
        """Settings with the changes of the camera and the labels."""
        import calib
        from perceptree.simulator.settings import ideal_camera

        intrinsics = settings.camera.intrinsics
        if self.camera is not None:
            intrinsics = calib.load_camera(self.camera)
        if self.width is not None or self.height is not None:
            size = (
                intrinsics.width if self.width is None else self.width,
                intrinsics.height if self.height is None else self.height,
            )
            stated = self.camera is not None or intrinsics != ideal_camera(
                intrinsics.width, intrinsics.height
            )
            intrinsics = intrinsics.scaled(*size) if stated else ideal_camera(*size)
        labels, views = settings.labels, self.views
        return replace(
            settings,
            camera=replace(settings.camera, intrinsics=intrinsics),
            labels=labels if self.reach is None else replace(labels, reach_m=self.reach),
            views_per_scene=settings.views_per_scene if views is None else views,
        )


@expand_groups
def synth(
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER|URL",
            help="Folder or URL (s3://...) to write; one with the same settings is resumed.",
        ),
    ],
    *,
    dataset: DatasetOptions,
    pictures: PictureOptions,
    workers: Annotated[
        int | None, typer.Option(help="Number of processes.", show_default="one per core")
    ] = None,
    share: ShareOptions,
    as_json: Json = False,
) -> None:
    """Simulate forest frames with colour, depth, masks, boxes, keypoints and metric truth."""
    from basetree.jobs import is_url
    from perceptree.simulator.dataset.generate import generate_dataset
    from perceptree.simulator.dataset.shards import SynthJob
    from perceptree.simulator.photographs.folder import with_photographs

    frozen = _frozen(dataset, pictures)
    start = chosen_preset(dataset.preset, dataset.settings)
    chosen = pictures.changed(start.settings)
    photographs = _photographs(pictures.textures)
    chosen = with_photographs(chosen, photographs)
    count = start.frames if dataset.frames is None else dataset.frames
    files = start.files
    if pictures.image_format is not None:
        files = replace(files, image_format=pictures.image_format)
    seed = start.seed if dataset.seed is None else dataset.seed
    if share.is_given or is_url(out):
        whole = SynthJob(share.store(out), count, chosen, seed, files, photographs)
        _in_shards(whole, share, workers, as_json, frozen)
        return
    tell = counter(_LABEL, shown=not as_json)
    report = generate_dataset(out, count, chosen, seed, workers, tell, files, photographs)
    print_result(report, as_json, frozen)


def _photographs(folder: Path | None) -> PhotoFolder | None:
    """Open and check the folder of --textures, and say on stderr what was done to its files."""
    if folder is None:
        return None
    from perceptree.simulator.photographs.checking import check_photographs
    from perceptree.simulator.photographs.folder import open_photographs

    photographs = open_photographs(folder)
    for line in check_photographs(photographs):
        note(f"textures: {line}")
    return photographs


def _in_shards(
    synth: SynthJob,
    share: ShareOptions,
    workers: int | None,
    as_json: bool,
    frozen: str | None,
) -> None:
    """Simulate a shard; with Ray, or without --shard, all of the dataset."""
    from basetree.jobs import Progress
    from perceptree.simulator.dataset.generate import check_workers
    from perceptree.simulator.dataset.shards import merge_shards, run_synth_shard

    if workers is not None:
        check_workers(workers)
    chosen, store = share.chosen(), synth.store
    progress = Progress(_LABEL)
    if share.ray is not None:
        from basetree.jobs.on_ray import RayEngine

        with RayEngine(share.ray) as engine:
            synth.prepare()
            engine.run(synth.job(), synth, progress)
            report = engine.call(merge_shards, store)
    else:
        run_synth_shard(synth, chosen, workers or os.cpu_count() or 1, progress)
        if share.shard is not None:
            print_shard(store, chosen, as_json)
            return
        report = merge_shards(store)
    print_result(report, as_json, frozen)


def _frozen(dataset: DatasetOptions, pictures: PictureOptions) -> str | None:
    """Return the preset if it is frozen; raise SettingsError if options would change it."""
    from perceptree.simulator.dataset.frozen import FROZEN_PRESETS

    preset = dataset.preset
    if preset not in FROZEN_PRESETS:
        return None
    if pictures != PictureOptions() or dataset != DatasetOptions(preset=preset):
        mix = "paper" if preset == "test" else "field"
        raise SettingsError(
            f"--preset {preset} is frozen: expected no options besides --out, --workers,"
            f" --shard, --ray and --json; use --preset {mix} to change settings"
        )
    return preset


def chosen_preset(name: str | None, settings_file: Path | None = None) -> Preset:
    """Return a preset, with the changes of a settings file.

    Args:
        name: Name of the preset; None for 400 frames in the conditions of `field`.
        settings_file: JSON file with changed settings.

    Raises:
        SettingsError: If the preset is unknown or the file is invalid.
    """
    from perceptree.simulator.settings import SimulatorSettings
    from perceptree.simulator.settings.field import field_settings
    from perceptree.simulator.settings.presets import PRESETS, Preset
    from perceptree.simulator.settings.reading import read_settings

    if name is not None and name not in PRESETS:
        known = "; ".join(f"{p.name} ({p.description})" for p in PRESETS.values())
        raise SettingsError(f"--preset is {name!r}: expected one of {known}")
    default = Preset("default", field_settings(SimulatorSettings()), 0, 400, "")
    start = PRESETS[name] if name else default
    if settings_file is None:
        return start
    return replace(start, settings=read_settings(settings_file, start.settings))
