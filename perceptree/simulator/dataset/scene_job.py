"""One scene on disk: its frames' files, and the shard that says they are all there."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import calib
from perceptree.simulator.dataset.storage import (
    SCENE_FOLDER,
    encode_jpeg,
    encode_png,
    to_millimetres,
    write_atomically,
)
from perceptree.simulator.labelling.annotate import frame_record
from perceptree.simulator.labelling.frame import Frame
from perceptree.simulator.settings import SimulatorSettings
from perceptree.simulator.settings.files import FileSettings

if TYPE_CHECKING:
    from perceptree.simulator.dataset.frames import Assets

MAX_SCENES = 1_000_000

_LIMIT_M = 65.535


@dataclass(frozen=True)
class SceneJob:
    """A scene to draw into a dataset: ``number`` counts the scenes, ``views`` its frames."""

    directory: Path
    settings: SimulatorSettings
    files: FileSettings
    dataset_seed: int
    number: int
    views: int

    @property
    def shard(self) -> Path:
        """The file with the records of the scene's frames, written when their files are there."""
        return self.directory / SCENE_FOLDER / f"{self.number:06d}.json"

    @property
    def scene_seed(self) -> int:
        """Decides the scene; no other scene of any dataset with the same settings has it."""
        return self.dataset_seed * MAX_SCENES + self.number

    def records(self) -> list[dict[str, Any]]:
        """The records of the scene's frames, empty unless all of them are on disk.

        A record holds the COCO ``image`` and ``annotations``, the ``bytes`` of each file and
        ``depth_valid_share``. A frame whose file is gone or of another size is not there.
        """
        try:
            records = json.loads(self.shard.read_text("utf-8"))[: self.views]
            complete = len(records) == self.views and all(
                (self.directory / name).stat().st_size == size
                for record in records
                for name, size in record["bytes"].items()
            )
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return []
        return records if complete else []


def draw_scene(job: SceneJob, assets: Assets) -> int:
    """Simulate a scene's frames, write their files, then its shard; returns how many frames.

    Raises OSError with the name of the file that cannot be written.
    """
    from perceptree.simulator.dataset.frames import simulate_frames

    first = job.number * job.settings.views_per_scene
    frames = simulate_frames(job.settings, job.scene_seed, job.views, assets)
    records = []
    for image_id, frame in enumerate(frames, start=first):
        record = frame_record(frame, image_id, job.files)
        record["bytes"] = {}
        for name, data in _files(frame, record["image"], job):
            write_atomically(job.directory / name, data)
            record["bytes"][name] = len(data)
        record["depth_valid_share"] = round(float(np.mean(frame.depth_m > 0)), 4)
        records.append(record)
    write_atomically(job.shard, json.dumps(records).encode())
    return len(records)


def _files(frame: Frame, image: dict[str, Any], job: SceneJob) -> Iterator[tuple[str, bytes]]:
    """Name and content of a frame's files."""
    jpeg = job.files.image_format == "jpg"
    quality = job.settings.rgb.jpeg_quality
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
