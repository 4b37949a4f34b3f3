"""Datasets simulated in shards: the scenes of a shard, and the dataset that all shards make."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from basetree.jobs import (
    Job,
    JobError,
    LocalStore,
    MergedParts,
    Progress,
    Shard,
    Store,
    copy_folder,
    fetch,
    read_manifests,
    write_manifest,
)
from perceptree.errors import DatasetError
from perceptree.simulator.dataset.contact_sheet import choose_frames
from perceptree.simulator.dataset.generate import SynthReport, collect, prepare, scene_jobs
from perceptree.simulator.dataset.plan import DatasetPlan
from perceptree.simulator.dataset.pool import draw_scenes
from perceptree.simulator.dataset.scene_job import SceneJob
from perceptree.simulator.dataset.storage import (
    FRAME_FOLDERS,
    IMU_FOLDER,
    SCENE_FOLDER,
    SETTINGS_FILE,
    storage_error,
)
from perceptree.simulator.photographs.folder import PhotoFolder
from perceptree.simulator.settings import SimulatorSettings
from perceptree.simulator.settings.files import FileSettings
from perceptree.simulator.settings.reading import read_settings

KIND = "perceptree.synth"
_COPIES = 8
Records = list[dict[str, Any]]


@dataclass(frozen=True)
class SynthJob:
    """A dataset to simulate on several machines.

    Attributes:
        store: Where the dataset is written.
        frames: Number of frames.
        settings: Settings of the simulator.
        seed: Seed of the dataset.
        files: File formats.
        photographs: Photographs that the settings name; None for none.

    Raises:
        SettingsError: If a number is out of range, or there are too few frames for the splits.
    """

    store: Store
    frames: int
    settings: SimulatorSettings
    seed: int
    files: FileSettings
    photographs: PhotoFolder | None = None

    def __post_init__(self) -> None:
        self.scenes()

    @property
    def plan(self) -> DatasetPlan:
        """What decides the dataset's content."""
        return DatasetPlan(self.settings, self.seed, self.files, self.photographs)

    def job(self) -> Job:
        """The work, with a unit for every scene."""
        identity = {"settings_sha256": self.plan.sha256}
        views = self.settings.views_per_scene
        return Job(self.store, KIND, identity, self.frames, views, SCENE_FOLDER)

    def scenes(self) -> list[SceneJob]:
        """All scenes."""
        if isinstance(self.store, LocalStore):
            return scene_jobs(self.store.folder, self.frames, self.plan)
        return scene_jobs(Path(), self.frames, self.plan, self.store)

    def prepare(self) -> None:
        """Write the settings, and make the folders.

        Raises:
            DatasetError: If the store holds a dataset with other settings, or cannot be written.
        """
        if isinstance(self.store, LocalStore):
            directory = self.store.folder
            try:
                prepare(directory, self.plan)
            except OSError as error:
                raise storage_error(error, directory) from error
        else:
            self.store.write(SETTINGS_FILE, self.plan.content())

    def __call__(self) -> Callable[[int], bytes]:
        """Start a worker of Ray: make the textures, and return what simulates a scene."""
        import cv2
        import numba

        from perceptree.simulator.dataset.frames import make_assets
        from perceptree.simulator.dataset.scene_job import draw_frames

        numba.set_num_threads(1)
        cv2.setNumThreads(1)
        if self.photographs is not None:
            self.photographs.check_unchanged()
        assets, scenes = make_assets(self.photographs), self.scenes()
        return lambda unit: draw_frames(scenes[unit], assets)


def run_synth_shard(synth: SynthJob, shard: Shard, workers: int, progress: Progress) -> None:
    """Simulate the scenes of a shard that are not finished, and write its manifest.

    Args:
        synth: The dataset.
        shard: The shard.
        workers: Maximum number of processes.
        progress: Told of the drawn frames.

    Raises:
        DatasetError: If a folder cannot be written, or a process is killed.
        StoreError: If a store cannot be written.
        JobError: If the store holds parts of another job.
    """
    job, scenes = synth.job(), synth.scenes()
    finished = job.open()
    synth.prepare()
    mine = [scenes[unit] for unit in shard.units(job.units)]
    missing = [scene for scene in mine if not _is_there(scene, finished)]
    total = sum(scene.views for scene in mine)
    progress.begin(total, total - sum(scene.views for scene in missing))
    last_s = time.monotonic()
    try:
        with closing(draw_scenes(missing, workers)) as drawn:
            for frames in drawn:
                now_s = time.monotonic()
                progress.add(frames, (now_s - last_s) * min(workers, len(missing)))
                last_s = now_s
    except OSError as error:
        raise storage_error(error, Path(synth.store.where)) from error
    write_manifest(job, shard, {})


def _is_there(scene: SceneJob, finished: set[int]) -> bool:
    """Whether a scene is finished; in a folder, its files are looked at."""
    if scene.number not in finished:
        return False
    return scene.store is not None or bool(scene.records())


def merge_shards(store: Store) -> SynthReport:
    """Complete the dataset in the store of all its shards; errors as for `merge_dataset`."""
    return merge_dataset(read_manifests([store], (KIND,)), store)


def merge_dataset(parts: MergedParts, out: Store) -> SynthReport:
    """Make the dataset of all shards: byte for byte that of one machine.

    Merging again does what is missing only. In the place of the shards, nothing is copied.

    Args:
        parts: The shards.
        out: Where to write the dataset.

    Raises:
        DatasetError: If `out` holds a dataset with other settings, or cannot be written.
        JobError: If files of a shard are missing.
        StoreError: If a store cannot be read or written.
    """
    settings = parts.job.store.read(SETTINGS_FILE)
    if _other_settings(out, settings):
        raise DatasetError(
            f"{out.where}/{SETTINGS_FILE}: has other settings than the shards; expected the same,"
            " or an empty folder"
        )
    out.write(SETTINGS_FILE, settings)
    stores = {store.where: store for store, _ in parts.parts.values()} | {out.where: out}
    sizes = {where: _sizes(store) for where, store in stores.items()}
    with ThreadPoolExecutor(_COPIES) as pool:
        scenes = list(
            pool.map(lambda unit: _copy_scene(parts, unit, out, sizes), range(parts.job.units))
        )
    _check_whole(parts, scenes)
    with tempfile.TemporaryDirectory() as folder:
        (path,) = fetch(parts.job.store, [SETTINGS_FILE], Path(folder))
        splits = read_settings(path, SimulatorSettings()).splits
        try:
            if isinstance(out, LocalStore):
                return collect(out.folder, scenes, splits)
            chosen = choose_frames([record for records in scenes for record in records])
            images = [record["image"] for record in chosen]
            names = [image[kind] for image in images for kind in ("file_name", "depth_file")]
            made = Path(folder) / "made"
            fetched = fetch(out, names, made)
            report = collect(made, scenes, splits)
            for picture in fetched:
                picture.unlink()
            copy_folder(made, out)
            return replace(report, directory=out.where)
        except OSError as error:
            raise storage_error(error, Path(out.where)) from error


def _other_settings(out: Store, settings: bytes) -> bool:
    return SETTINGS_FILE in out.sizes("") and out.read(SETTINGS_FILE) != settings


def _sizes(store: Store) -> dict[str, int]:
    """Bytes of the files of all frames in a store."""
    found: dict[str, int] = {}
    for folder in (*FRAME_FOLDERS, IMU_FOLDER):
        found |= store.sizes(folder)
    return found


def _copy_scene(
    parts: MergedParts, unit: int, out: Store, sizes: dict[str, dict[str, int]]
) -> Records:
    """Copy the files of a scene and its record; returns the records, none if a file is missing."""
    store = parts.parts[unit][0]
    content = parts.read(unit)
    there, here = sizes[store.where], sizes[out.where]
    try:
        records: Records = json.loads(content)[: parts.job.frames_of(unit)]
        files = [record["bytes"].items() for record in records]
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise JobError(
            f"{store.where}/{parts.job.part(unit)}: not the record of a scene ({error!r:.100}),"
            " expected one that perceptree synth wrote"
        ) from error
    for each in files:
        for name, size in each:
            if there.get(name) != size:
                return []
            if here.get(name) != size:
                out.write(name, store.read(name))
    if store.where != out.where:
        out.write(parts.job.part(unit), content)
    return records


def _check_whole(parts: MergedParts, scenes: list[Records]) -> None:
    """Raise JobError if files of a scene are missing, and have the scene done again."""
    broken = [unit for unit, records in enumerate(scenes) if not records]
    for unit in broken:
        parts.parts[unit][0].remove(parts.job.part(unit))
    if broken:
        raise JobError(
            f"{parts.job.store.where}: files of {len(broken)} scenes are missing or have another"
            " size; run the shards again to make them, and merge again"
        )
