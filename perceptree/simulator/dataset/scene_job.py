"""The files of one scene: its frames, and a shard file with their records."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import calib
from basetree.arrays import Float
from basetree.jobs import Store, copy_folder
from perceptree.simulator.dataset.plan import DatasetPlan
from perceptree.simulator.dataset.storage import (
    FRAME_FOLDERS,
    IMU_FOLDER,
    SCENE_FOLDER,
    encode_jpeg,
    encode_png,
    to_millimetres,
    write_atomically,
)
from perceptree.simulator.labelling.annotate import frame_record
from perceptree.simulator.labelling.frame import LabelledFrame

if TYPE_CHECKING:
    from perceptree.simulator.dataset.frames import Assets

MAX_SCENES = 1_000_000

_LIMIT_M = 65.535
_IMU_COLUMNS = (
    "time_s",
    "gyro_x_rad_per_s",
    "gyro_y_rad_per_s",
    "gyro_z_rad_per_s",
    "accel_x_m_per_s2",
    "accel_y_m_per_s2",
    "accel_z_m_per_s2",
)


@dataclass(frozen=True)
class SceneJob:
    """A scene of a dataset.

    Attributes:
        directory: Folder of the dataset; not used with a store.
        plan: What decides the dataset's content.
        number: Number of the scene in the dataset.
        views: Number of frames.
        store: Object store of the dataset; None for a folder.
    """

    directory: Path
    plan: DatasetPlan
    number: int
    views: int
    store: Store | None = None

    @property
    def record_file(self) -> str:
        """File with the records of the scene's frames, relative to the dataset."""
        return f"{SCENE_FOLDER}/{self.number:06d}.json"

    @property
    def shard(self) -> Path:
        """File with the records of the scene's frames, written after all files of the frames."""
        return self.directory / self.record_file

    @property
    def imu_file(self) -> str:
        """File with the IMU samples of a drive, relative to the dataset."""
        return f"{IMU_FOLDER}/{self.number:06d}.csv"

    @property
    def scene_seed(self) -> int:
        """Seed of the scene, different for every scene of every dataset seed."""
        return self.plan.seed * MAX_SCENES + self.number

    def records(self) -> list[dict[str, Any]]:
        """Read the records of the scene's frames.

        A record has the COCO `image` and `annotations`, the size of each file (`bytes`) and
        `depth_valid_share`.

        Independent views are the first ones of a longer scene, too. A drive depends on its number
        of frames, so a longer or shorter one is another one.

        Returns:
            One record per frame; none if the scene is not finished, or a file is missing or has
            another size.
        """
        try:
            records = json.loads(self.shard.read_text("utf-8"))
            if not self.plan.settings.drive.rate_hz:
                records = records[: self.views]
            complete = len(records) == self.views and all(
                (self.directory / name).stat().st_size == size
                for record in records
                for name, size in record["bytes"].items()
            )
        except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
            return []
        return records if complete else []


def draw_scene(job: SceneJob, assets: Assets, drawn: Callable[[], None] = lambda: None) -> int:
    """Simulate a scene, and write the files of its frames and then its shard.

    Args:
        job: The scene.
        assets: Textures and shared meshes.
        drawn: Called after each frame.

    Returns:
        Number of frames.

    Raises:
        OSError: If a file cannot be written; it has the name of the file.
        StoreError: If a file cannot be written to the store.
    """
    content = draw_frames(job, assets, drawn)
    if job.store is None:
        write_atomically(job.shard, content)
    else:
        job.store.write(job.record_file, content)
    return job.views


def draw_frames(job: SceneJob, assets: Assets, drawn: Callable[[], None] = lambda: None) -> bytes:
    """Do as `draw_scene`, but return the content of the shard file instead of writing it."""
    if job.store is None:
        return json.dumps(_draw_here(job, assets, drawn)).encode()
    with tempfile.TemporaryDirectory() as folder:
        for name in FRAME_FOLDERS:
            (Path(folder) / name).mkdir()
        records = _draw_here(replace(job, directory=Path(folder), store=None), assets, drawn)
        copy_folder(Path(folder), job.store)
    return json.dumps(records).encode()


def _draw_here(job: SceneJob, assets: Assets, drawn: Callable[[], None]) -> list[dict[str, Any]]:
    """Simulate a scene, write the files of its frames, and return their records."""
    from perceptree.simulator.dataset.frames import simulate_frames

    first = job.number * job.plan.settings.views_per_scene
    frames = simulate_frames(job.plan.settings, job.scene_seed, job.views, assets)
    records, measured = [], []
    for image_id, frame in enumerate(frames, start=first):
        record = frame_record(frame, image_id, job.plan.files)
        record["bytes"] = {}
        if frame.motion is not None:
            measured.append(frame.motion.imu)
            record["image"]["imu_file"] = job.imu_file
        for name, data in _files(frame, record["image"], job):
            write_atomically(job.directory / name, data)
            record["bytes"][name] = len(data)
        record["depth_valid_share"] = round(float(np.mean(frame.depth_m > 0)), 4)
        records.append(record)
        drawn()
    if measured:
        data = _imu_table(np.concatenate(measured))
        (job.directory / job.imu_file).parent.mkdir(exist_ok=True)
        write_atomically(job.directory / job.imu_file, data)
        records[-1]["bytes"][job.imu_file] = len(data)
    return records


def _imu_table(samples: Float) -> bytes:
    """CSV of IMU samples (n, 7) in camera axes: right, down and forward."""
    lines = [",".join(_IMU_COLUMNS)]
    lines += [",".join(f"{value:.7g}" for value in row) for row in samples]
    return ("\n".join(lines) + "\n").encode()


def _files(
    frame: LabelledFrame, image: dict[str, Any], job: SceneJob
) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each of a frame's files."""
    jpeg = job.plan.files.image_format == "jpg"
    quality = job.plan.settings.rgb.jpeg_quality
    yield (
        image["file_name"],
        encode_jpeg(frame.image, quality) if jpeg else encode_png(frame.image),
    )
    measured = to_millimetres(frame.depth_m, _LIMIT_M)
    flat = frame.depth_sensor["kind"] == "stereo"
    yield image["depth_file"], encode_png(measured, flat)
    metres = measured.astype(np.float32) / np.float32(1000)
    eight_bit = calib.encode_depth(metres, calib.DepthEncoding())
    yield image["depth8_file"], encode_png(eight_bit, flat)
    exact = to_millimetres(frame.exact_depth_m, _LIMIT_M)
    yield image["depth_exact_file"], encode_png(exact)
