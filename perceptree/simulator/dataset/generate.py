"""Generate datasets in COCO's format: parallel, resumable, and split by scene."""

from __future__ import annotations

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
from perceptree.simulator.dataset.plan import DatasetPlan
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
from perceptree.simulator.photographs.folder import PhotoFolder
from perceptree.simulator.settings import SimulatorSettings, SplitSettings
from perceptree.simulator.settings.checks import check_number
from perceptree.simulator.settings.files import FileSettings

MAX_FRAMES = MAX_SCENES - 1
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
        photographs: Photographs that the scenes show besides, of `open_photographs`.

    Raises:
        SettingsError: If a number is out of range, there are too few frames for the splits, or a
            photograph cannot be used.
        DatasetError: If the folder cannot be written or holds other settings, or a process is
            killed.
    """
    if workers is not None:
        check_workers(workers)
    plan = DatasetPlan(settings, seed, files, photographs)
    jobs = scene_jobs(directory, frames, plan)
    try:
        prepare(directory, plan)
        try:
            _render_missing(jobs, workers or os.cpu_count() or 1, progress)
        finally:
            remove_leftovers(directory)
        return collect(directory, _all_records(jobs), plan.settings.splits)
    except OSError as error:
        raise storage_error(error, directory) from error


def check_workers(workers: int) -> None:
    """Raise SettingsError if a number of processes is not from 1 to 1024."""
    check_number("workers", workers, 1, 1024)


def scene_jobs(
    directory: Path, frames: int, plan: DatasetPlan, store: Store | None = None
) -> list[SceneJob]:
    """Return the scenes of a dataset.

    Args:
        directory: Folder of the dataset; not used with a store.
        frames: Number of frames.
        plan: What decides its content.
        store: Object store of the dataset; None for a folder.

    Raises:
        SettingsError: If `frames` is out of range, or too few for the splits.
    """
    check_number("frames", frames, 1, MAX_FRAMES)
    views = plan.settings.views_per_scene
    scenes = math.ceil(frames / views)
    splits = split_shares(plan.settings.splits)
    if scenes < len(splits):
        raise SettingsError(
            f"frames is {frames}, which makes {scenes} scene{'s' * (scenes > 1)} of {views} views:"
            f" expected at least {(len(splits) - 1) * views + 1}, for a scene in each of the splits"
            f" {', '.join(splits)}"
        )
    return [
        SceneJob(directory, plan, n, min(views, frames - n * views), store) for n in range(scenes)
    ]


def prepare(directory: Path, plan: DatasetPlan) -> None:
    """Make a dataset's folders and its `settings.json`.

    Raises:
        DatasetError: If the folder holds a dataset with other settings or another seed.
        OSError: If it cannot be written.
    """
    record = directory / SETTINGS_FILE
    for name in (*FRAME_FOLDERS, SCENE_FOLDER):
        (directory / name).mkdir(parents=True, exist_ok=True)
    remove_leftovers(directory)
    if record.exists() and _digest_in(record) != plan.sha256:
        also = ", or other photographs" if plan.settings.photographs.sha256 else ""
        raise DatasetError(
            f"{record}: has other settings or another seed{also}; expected the same to resume, or"
            " an empty folder"
        )
    write_atomically(record, plan.content())


def _digest_in(record: Path) -> object:
    try:
        content = json.loads(record.read_text("utf-8"))
    except (ValueError, RecursionError):
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
