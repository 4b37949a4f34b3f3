"""Writes datasets: scenes drawn by all cores, resumable, split by scene, in COCO's format."""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import calib
from perceptree.errors import DatasetError
from perceptree.simulator.annotate import Frame, coco_dataset, frame_record
from perceptree.simulator.camera import random_view
from perceptree.simulator.labels import label_view
from perceptree.simulator.render import Renderer
from perceptree.simulator.scene import Prototypes, build_scene, make_prototypes
from perceptree.simulator.sensor import expose, measure_depth
from perceptree.simulator.settings import SimulatorSettings
from perceptree.simulator.textures import Textures, make_textures

SPLITS = ("train", "val", "test")
_JPEG_QUALITY = 92
_PNG_LEVEL = 2
_HELD_OUT_SHARE = 0.1

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class SynthReport:
    """What was written: folder, frames and labelled trees per split."""

    directory: Path
    frames: dict[str, int]
    trees: dict[str, int]


@dataclass(frozen=True)
class _Job:
    directory: Path
    settings: SimulatorSettings
    seed: int
    scene: int
    views: int

    @property
    def shard(self) -> Path:
        """File that exists once all frames of the scene do."""
        return self.directory / "scenes" / f"{self.scene:06d}.json"


@dataclass
class _Worker:
    textures: Textures
    prototypes: Prototypes


_worker: _Worker | None = None


def _start_worker() -> None:
    import numba

    global _worker  # one set of textures and meshes per process
    numba.set_num_threads(1)
    cv2.setNumThreads(1)
    _worker = _Worker(make_textures(), make_prototypes())


def simulate_frames(
    settings: SimulatorSettings, seed: int, views: int, textures: Textures, prototypes: Prototypes
) -> list[Frame]:
    """All frames of one scene: pictures, depth and labels in memory."""
    scene = build_scene(settings, prototypes, seed)
    renderer = Renderer(textures, scene)
    frames = []
    for number in range(views):
        rng = np.random.default_rng([seed, 2, number])
        view = random_view(rng, settings.camera, scene)
        drawing = renderer.draw(view)
        frames.append(
            Frame(
                expose(rng, settings.sensor, drawing),
                measure_depth(rng, settings.sensor, drawing.depth_m),
                label_view(view, drawing, scene.trees, settings.labels),
                view,
                seed,
            )
        )
    return frames


def _write_atomically(path: Path, data: bytes) -> None:
    beside = path.with_name(path.name + ".part")
    beside.write_bytes(data)
    beside.replace(path)


def _encode(extension: str, image: Any, options: list[int]) -> bytes:
    return bytes(cv2.imencode(extension, image, options)[1])


def _run_job(job: _Job) -> int:
    assert _worker is not None
    seed = job.seed * 1_000_000 + job.scene
    frames = simulate_frames(job.settings, seed, job.views, _worker.textures, _worker.prototypes)
    records = []
    png = [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL]
    for number, frame in enumerate(frames):
        image_id = job.scene * job.settings.views_per_scene + number
        record = frame_record(frame, image_id)
        millimetres = np.round(frame.depth_m * 1000).astype(np.uint16)
        eight_bit = calib.encode_depth(frame.depth_m, calib.DepthEncoding())
        for name, data in (
            (record["image"]["file_name"], _encode(
                ".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])),
            (record["image"]["depth_file"], _encode(".png", millimetres, png)),
            (record["image"]["depth8_file"], _encode(".png", eight_bit, png)),
        ):  # fmt: skip
            _write_atomically(job.directory / name, data)
        records.append(record)
    _write_atomically(job.shard, json.dumps(records).encode())
    return len(records)


def split_of(scene: int, scenes: int) -> str:
    """Which split a scene belongs to: about a tenth each for val and test, at least one."""
    held_out = max(1, round(scenes * _HELD_OUT_SHARE))
    if scene >= scenes - held_out:
        return "test"
    return "val" if scene >= scenes - 2 * held_out else "train"


def _prepare(directory: Path, settings: SimulatorSettings, seed: int) -> None:
    """Make the folders, and refuse to mix frames of other settings into a dataset."""
    content = {"settings": settings.to_dict(), "seed": seed, "version": 1}
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    content["sha256"] = digest
    record = directory / "settings.json"
    try:
        for name in ("images", "depth", "depth8", "scenes"):
            (directory / name).mkdir(parents=True, exist_ok=True)
        if record.exists() and json.loads(record.read_text()).get("sha256") != digest:
            raise DatasetError(
                f"{record}: holds other settings or another seed; expected the same ones to resume,"
                " or an empty folder"
            )
        _write_atomically(record, json.dumps(content, indent=1).encode())
    except OSError as error:
        raise DatasetError(f"{directory}: cannot be written ({error.strerror})") from error


def generate_dataset(
    directory: Path,
    frames: int,
    settings: SimulatorSettings,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = lambda done, total: None,
) -> SynthReport:
    """Simulate ``frames`` frames into ``directory`` and write the three COCO files.

    Scenes that a run before this one finished are kept. Raises DatasetError where the folder
    cannot be written, holds other settings, or ``frames`` is too few for three splits.
    """
    scenes = math.ceil(frames / settings.views_per_scene)
    if scenes < 3:
        raise DatasetError(
            f"{frames} frames make {scenes} scenes: expected at least three scenes of"
            f" {settings.views_per_scene} views, one for each split"
        )
    _prepare(directory, settings, seed)
    jobs = []
    for scene in range(scenes):
        views = min(settings.views_per_scene, frames - scene * settings.views_per_scene)
        jobs.append(_Job(directory, settings, seed, scene, views))
    _draw_missing(jobs, workers or os.cpu_count() or 1, frames, progress)
    return _collect(directory, jobs)


def _draw_missing(jobs: list[_Job], workers: int, frames: int, progress: Progress) -> None:
    missing = [job for job in jobs if not job.shard.exists()]
    done = frames - sum(job.views for job in missing)
    progress(done, frames)
    if not missing:
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(missing)), context, _start_worker) as pool:
        pending = [pool.submit(_run_job, job) for job in missing]
        try:
            for job in as_completed(pending):
                done += job.result()
                progress(done, frames)
        except OSError as error:
            raise DatasetError(
                f"{error.filename}: cannot be written ({error.strerror}); run again to resume"
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _collect(directory: Path, jobs: list[_Job]) -> SynthReport:
    frames, trees = {}, {}
    for split in SPLITS:
        records = []
        for job in jobs:
            if split_of(job.scene, len(jobs)) == split:
                records += json.loads(job.shard.read_text())[: job.views]
        frames[split] = len(records)
        trees[split] = sum(len(record["annotations"]) for record in records)
        _write_atomically(
            directory / f"{split}_RGB.json", json.dumps(coco_dataset(records)).encode()
        )
    return SynthReport(directory, frames, trees)
