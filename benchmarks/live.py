"""Rate and latency of the live pipeline on a recording of raw or compressed colour and depth.

python benchmarks/live.py --result benchmarks/results/live.json

The recordings are MCAP files of the package's samples, 1280x720, made for the run. Each sample is
shown for a second, as a machine that stands shows it, so that its stems are followed. `detect`
alone runs on the same frames in memory, in turn with the whole chain: reading, detection,
measurement, tracking, and JSON lines to a file. The share is the chain's rate divided by that of
`detect`. For the latency, the recording is played as a camera would deliver it, somewhat slower
than the chain manages; the latency is the time from a frame's arrival to its written result, in
frame times.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from calib import PinholeCamera
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.live import LivePipeline
from edgetree.runtime.providers import import_onnxruntime
from edgetree.sinks import JsonLinesSink
from edgetree.sources import open_recording
from edgetree.sources.playing import PacedSource

TARGETS = {"raw_share": 0.75, "latency_frames": 2.0}
PERIOD_S = 0.1
HOLD = 10  # frames of one sample
PACE = 0.8  # of the chain's rate, for the latency
COMPRESSED_DEPTH_HEADER = 12  # bytes before the PNG
TYPES = {
    "image": "sensor_msgs/msg/Image",
    "packed": "sensor_msgs/msg/CompressedImage",
    "camera": "sensor_msgs/msg/CameraInfo",
}

Pixels = NDArray[Any]


class Recording:
    """Writes frames to an MCAP file."""

    def __init__(self, folder: Path, *, compressed: bool) -> None:
        self._store = get_typestore(Stores.LATEST)
        self._compressed = compressed
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        kind = "packed" if compressed else "image"
        topics = {
            "colour": ("/camera/color/image_raw" + "/compressed" * compressed, kind),
            "depth": ("/camera/depth/image_raw" + "/compressedDepth" * compressed, kind),
            "camera": ("/camera/color/camera_info", "camera"),
        }
        self._connections = {
            role: (self._writer.add_connection(name, TYPES[kind], typestore=self._store), kind)
            for role, (name, kind) in topics.items()
        }

    def add(self, image: Pixels, depth_mm: Pixels, camera: PinholeCamera, time_s: float) -> None:
        """Write one frame."""
        make = self._store.types
        seconds, part = divmod(round(time_s * 1e9), 10**9)
        stamp = make["builtin_interfaces/msg/Time"](sec=seconds, nanosec=part)
        header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
        for role, pixels, encoding in (("colour", image, "bgr8"), ("depth", depth_mm, "16UC1")):
            values = self._packed(role, pixels) if self._compressed else _raw(pixels, encoding)
            self._write(role, {"header": header, **values}, time_s)
        region = make["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], np.float64)
        values = {
            "header": header,
            "height": camera.height,
            "width": camera.width,
            "distortion_model": "plumb_bob",
            "d": np.zeros(5),
            "k": k,
            "r": np.eye(3).ravel(),
            "p": np.insert(k, [3, 6, 9], 0.0),
            "binning_x": 0,
            "binning_y": 0,
            "roi": region,
        }
        self._write("camera", values, time_s)

    def _packed(self, role: str, pixels: Pixels) -> dict[str, Any]:
        if role == "colour":
            data, form = cv2.imencode(".jpg", pixels)[1].ravel(), "bgr8; jpeg compressed bgr8"
        else:
            png = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].ravel()
            head = np.zeros(COMPRESSED_DEPTH_HEADER, np.uint8)
            data, form = np.concatenate([head, png]), "16UC1; compressedDepth png"
        return {"format": form, "data": data}

    def _write(self, role: str, values: dict[str, Any], time_s: float) -> None:
        connection, kind = self._connections[role]
        message = self._store.types[TYPES[kind]](**values)
        data = self._store.serialize_cdr(message, TYPES[kind])
        self._writer.write(connection, round(time_s * 1e9), data)

    def close(self) -> None:
        """Complete the file."""
        self._writer.close()


def _raw(pixels: Pixels, encoding: str) -> dict[str, Any]:
    """The fields of an uncompressed image."""
    return {
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": pixels.strides[0],
        "data": np.frombuffer(pixels.tobytes(), np.uint8),
    }


def record(folder: Path, frames: int, period_s: float, *, compressed: bool) -> Path:
    """Make a recording of the samples, one after the other."""
    samples = [
        (
            sample.image(),
            cv2.imdecode(np.fromfile(sample.depth_path, np.uint8), cv2.IMREAD_UNCHANGED),
            sample.camera,
        )
        for sample in sample_frames()
    ]
    recording = Recording(folder, compressed=compressed)
    for number in range(frames):
        recording.add(*samples[number // HOLD % len(samples)], time_s=1.0 + number * period_s)
    recording.close()
    return folder


def detect_rate_hz(detector: TreeDetector, frames: int) -> float:
    """Rate of `detect` alone."""
    images = [sample.depth_m() for sample in sample_frames()]
    start = time.perf_counter()
    for number in range(frames):
        detector.detect(images[number // HOLD % len(images)])
    return frames / (time.perf_counter() - start)


def chain_rate_hz(detector: TreeDetector, recording: Path, lines: Path) -> float:
    """Rate of the whole chain, from the first result to the last."""
    sink, times = JsonLinesSink(lines), []
    for result in LivePipeline(lambda: open_recording(recording), detector):
        sink.write(result)
        times.append(time.perf_counter())
    sink.close()
    return (len(times) - 1) / (times[-1] - times[0])


def latency_s(detector: TreeDetector, recording: Path, lines: Path) -> list[float]:
    """Time from the arrival of each frame to its written result."""
    sink, ages = JsonLinesSink(lines), []
    for result in LivePipeline(lambda: PacedSource(open_recording(recording)), detector):
        before = time.perf_counter()
        sink.write(result)
        ages.append(result.age_s + time.perf_counter() - before)
    sink.close()
    return ages[len(ages) // 10 :]


def main() -> None:
    """Print the results as JSON, and optionally write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2, help="threads of an inference")
    parser.add_argument("--result", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    detector = TreeDetector.load(default_model("depth"), threads=arguments.threads, warm_up=True)
    with tempfile.TemporaryDirectory() as name:
        folder, lines = Path(name), Path(name) / "lines.jsonl"
        bags = {
            kind: record(folder / kind, arguments.frames, PERIOD_S, compressed=kind == "compressed")
            for kind in ("raw", "compressed")
        }
        rows = [
            {
                "detect": detect_rate_hz(detector, arguments.frames),
                **{kind: chain_rate_hz(detector, bag, lines) for kind, bag in bags.items()},
            }
            for _ in range(arguments.rounds)
        ]
        rates = {kind: statistics.median(row[kind] for row in rows) for kind in rows[0]}
        shares = {
            f"{kind}_share": statistics.median(row[kind] / row["detect"] for row in rows)
            for kind in bags
        }
        period_s = 1 / (PACE * rates["raw"])
        paced = record(folder / "paced", arguments.frames, period_s, compressed=False)
        ages = latency_s(detector, paced, lines)
    figures = {
        **shares,
        "latency_frames": statistics.median(ages) / period_s,
        "latency_frames_p99": float(np.percentile(ages, 99)) / period_s,
    }
    result = {
        "machine": platform.processor() or platform.machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "threads": arguments.threads,
        "frame": "1280x720",
        "rates_hz": {kind: round(rate, 2) for kind, rate in rates.items()},
        **{key: round(value, 3) for key, value in figures.items()},
        "frame_time_ms": round(period_s * 1000, 1),
        "targets": TARGETS,
        "missed": [
            name
            for name, target in TARGETS.items()
            if (figures[name] > target) == name.startswith("latency")
        ],
    }
    text = json.dumps(result, indent=2)
    sys.stdout.write(text + "\n")
    if arguments.result:
        arguments.result.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
