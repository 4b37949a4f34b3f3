"""Generate datasets in COCO's format: parallel, resumable, and split by scene."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from basetree.errors import SettingsError
from basetree.jobs import Store
from perceptree.errors import DatasetError
from perceptree.simulator.dataset.contact_sheet import write_contact_sheets
from perceptree.simulator.dataset.pages import write_statistics
from perceptree.simulator.dataset.pool import draw_scenes
from perceptree.simulator.dataset.scene_job import MAX_SCENES, SceneJob
from perceptree.simulator.dataset.splits import SPLITS, assign_splits, split_shares
from perceptree.simulator.dataset.statistics import conditions
from perceptree.simulator.dataset.storage import (
    FRAME_FOLDERS,
    SCENE_FOLDER,
    SETTINGS_FILE,
    remove_leftovers,
    storage_error,
    write_atomically,
)
from perceptree.simulator.labelling.annotate import coco_dataset
from perceptree.simulator.photographs.folder import CREDITS, PhotoFolder, with_photographs
from perceptree.simulator.settings import SimulatorSettings, SplitSettings
from perceptree.simulator.settings.checks import check_number
from perceptree.simulator.settings.files import FileSettings

MAX_FRAMES = MAX_SCENES - 1
MAX_SEED = 999_999
_VERSION = 2
_FILES = FileSettings()

Progress = Callable[[int, int], None]
Splits = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class SynthReport:
    """Summary of a generated dataset.

    Attributes:
        directory: Folder of the dataset, or its URL in an object store.
        frames: Number of frames by split.
        trees: Number of labelled trees by split.
        conditions: Number of frames by kind of condition and value.
    """

    directory: Path | str
    frames: dict[str, int]
    trees: dict[str, int]
    conditions: dict[str, dict[str, int]]


def settings_sha256(settings: SimulatorSettings, seed: int, files: FileSettings = _FILES) -> str:
    """Hash everything that determines a dataset's bytes, except for the number of frames."""
    content = json.dumps(_settings_record(settings, seed, files), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def generate_dataset(
    directory: Path,
    frames: int,
    settings: SimulatorSettings,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = lambda done, total: None,
    files: FileSettings = _FILES,
    photographs: PhotoFolder | None = None,
) -> SynthReport:
    """Simulate a dataset, and write its images, COCO files, contact sheets and statistics.

    Finished scenes of an earlier run are kept. An interrupted run can thus be resumed, and a
    dataset extended by more frames with the same settings and seed; every scene stays in its
    split.

    Args:
        directory: Folder of the dataset.
        frames: Number of frames.
        settings: Settings of the simulator.
        seed: Seed of the dataset.
        workers: Number of processes; by default one per core.
        progress: Called with the number of finished frames and their total.
        files: File formats.
        photographs: Photographs that the scenes show besides, of ``open_photographs``.

    Raises:
        SettingsError: If a number is out of range, there are too few frames for the splits, or a
            photograph cannot be used.
        DatasetError: If the folder cannot be written or holds other settings, or a process is
            killed.
    """
    if workers is not None:
        check_number("workers", workers, 1, 1024)
    settings = with_photographs(settings, photographs)
    jobs = scene_jobs(directory, frames, settings, seed, files, photographs=photographs)
    try:
        prepare(directory, settings, seed, files, photographs)
        try:
            _render_missing(jobs, workers or os.cpu_count() or 1, progress)
        finally:
            remove_leftovers(directory)
        return collect(directory, _all_records(jobs), settings.splits)
    except OSError as error:
        raise storage_error(error, directory) from error


def scene_jobs(
    directory: Path,
    frames: int,
    settings: SimulatorSettings,
    seed: int,
    files: FileSettings,
    store: Store | None = None,
    photographs: PhotoFolder | None = None,
) -> list[SceneJob]:
    """Return the scenes of a dataset.

    Args:
        directory: Folder of the dataset; not used with a store.
        frames: Number of frames.
        settings: Settings of the simulator.
        seed: Seed of the dataset.
        files: File formats.
        store: Object store of the dataset; None for a folder.
        photographs: Photographs that the settings name; None for none.

    Raises:
        SettingsError: If a number is out of range, there are too few frames for the splits, or the
            settings name other photographs.
    """
    check_number("frames", frames, 1, MAX_FRAMES)
    check_number("seed", seed, 0, MAX_SEED)
    settings = with_photographs(settings, photographs)
    views = settings.views_per_scene
    scenes = math.ceil(frames / views)
    splits = split_shares(settings.splits)
    if scenes < len(splits):
        raise SettingsError(
            f"frames is {frames}, which makes {scenes} scene{'s' * (scenes > 1)} of {views} views:"
            f" expected at least {(len(splits) - 1) * views + 1}, for a scene in each of the splits"
            f" {', '.join(splits)}"
        )
    return [
        SceneJob(
            directory, settings, files, seed, n, min(views, frames - n * views), store, photographs
        )
        for n in range(scenes)
    ]


def _settings_record(settings: SimulatorSettings, seed: int, files: FileSettings) -> dict[str, Any]:
    return {
        "settings": settings.to_dict(),
        "seed": seed,
        "files": dataclasses.asdict(files),
        "version": _VERSION,
    }


def settings_content(
    settings: SimulatorSettings,
    seed: int,
    files: FileSettings,
    photographs: PhotoFolder | None = None,
) -> bytes:
    """Make the content of a dataset's ``settings.json``, with the credits of its photographs."""
    digest = settings_sha256(settings, seed, files)
    content = {**_settings_record(settings, seed, files), "sha256": digest}
    if photographs is not None:
        content[CREDITS] = photographs.credits
    return json.dumps(content, indent=1).encode()


def prepare(
    directory: Path,
    settings: SimulatorSettings,
    seed: int,
    files: FileSettings,
    photographs: PhotoFolder | None = None,
) -> None:
    """Make a dataset's folders and its ``settings.json``.

    Raises:
        DatasetError: If the folder holds a dataset with other settings or another seed.
        OSError: If it cannot be written.
    """
    record = directory / SETTINGS_FILE
    for name in (*FRAME_FOLDERS, SCENE_FOLDER):
        (directory / name).mkdir(parents=True, exist_ok=True)
    remove_leftovers(directory)
    digest = settings_sha256(settings, seed, files)
    if record.exists() and _digest_in(record) != digest:
        also = ", or other photographs" if settings.photographs.sha256 else ""
        raise DatasetError(
            f"{record}: has other settings or another seed{also}; expected the same to resume, or"
            " an empty folder"
        )
    write_atomically(record, settings_content(settings, seed, files, photographs))


def _digest_in(record: Path) -> object:
    try:
        content = json.loads(record.read_text("utf-8"))
    except ValueError:
        return None
    return content.get("sha256") if isinstance(content, dict) else None


def _render_missing(jobs: list[SceneJob], workers: int, progress: Progress) -> None:
    frames = sum(job.views for job in jobs)
    missing = [job for job in jobs if not job.records()]
    done = frames - sum(job.views for job in missing)
    progress(done, frames)
    with closing(draw_scenes(missing, workers)) as scenes:
        for drawn in scenes:
            done += drawn
            progress(done, frames)


def _all_records(jobs: list[SceneJob]) -> Iterator[list[dict[str, Any]]]:
    for job in jobs:
        records = job.records()
        if not records:
            raise DatasetError(
                f"{job.shard}: files of its frames are missing; run the same command again to"
                " make them"
            )
        yield records


def collect(
    directory: Path, scenes: Iterable[list[dict[str, Any]]], settings: SplitSettings
) -> SynthReport:
    """Write the files about all scenes: COCO files, contact sheets and statistics.

    Args:
        directory: Folder with the pictures, at least those of the contact sheets.
        scenes: Records of the frames of each scene.
        settings: Fractions of the splits.

    Raises:
        DatasetError: If a picture cannot be read.
        OSError: If a file cannot be written.
    """
    read = list(scenes)
    splits: Splits = {split: [] for split in SPLITS}
    for records, split in zip(read, assign_splits(len(read), settings), strict=True):
        splits[split] += records
    for split, records in splits.items():
        if records:
            content = json.dumps(coco_dataset(records)).encode()
            write_atomically(directory / f"{split}_RGB.json", content)
    write_contact_sheets(directory, splits)
    figures = write_statistics(directory, splits)
    return SynthReport(
        directory,
        {split: len(records) for split, records in splits.items()},
        {split: sum(len(r["annotations"]) for r in records) for split, records in splits.items()},
        conditions(figures),
    )
