"""Rate and latency of the live pipeline on a recording of raw or compressed colour and depth.

python -m benchmarks.live --result benchmarks/results/live.json

The recordings are MCAP files of the package's samples, 1280x720, made for the run. Each sample is
shown for a second, as a machine that stands shows it, so that its stems are followed. `detect`
alone runs on the same frames in memory, in turn with the whole chain: reading, detection,
measurement, tracking, and JSON lines to a file. The share is the chain's rate divided by that of
`detect`. For the latency, the recording is played as a camera would deliver it, somewhat slower
than the chain manages; the latency is the time from a frame's arrival to its written result, in
frame times.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.tools.program import finish, machine, program
from calib import PinholeCamera
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.live import LivePipeline
from edgetree.runtime.providers import import_onnxruntime
from edgetree.sinks import JsonLinesSink
from edgetree.sinks.bag import BagFolder
from edgetree.sinks.ros_types import RosTypes, time_ns
from edgetree.sources import open_recording
from edgetree.sources.playing import PacedSource

TARGETS = {"raw_share": 0.75, "latency_frames": 2.0}
PERIOD_S = 0.1
HOLD = 10  # frames of one sample
PACE = 0.8  # of the chain's rate, for the latency
COMPRESSED_DEPTH_HEADER = 12  # bytes before the PNG
SUFFIXES = {"bgr8": "/compressed", "16UC1": "/compressedDepth"}  # of compressed topics

Pixels = NDArray[Any]


class Recording:
    """Writes frames to an MCAP file, as a ROS driver of a camera does."""

    def __init__(self, folder: Path, *, compressed: bool) -> None:
        self._types = RosTypes()
        self._bag = BagFolder(folder, self._types.store)
        self._compressed = compressed

    def add(self, image: Pixels, depth_mm: Pixels, camera: PinholeCamera, time_s: float) -> None:
        """Write one frame."""
        header = self._types.header(time_s, "camera")
        for topic, pixels, encoding in (
            ("/camera/color/image_raw", image, "bgr8"),
            ("/camera/depth/image_raw", depth_mm, "16UC1"),
        ):
            if self._compressed:
                suffix, kind = SUFFIXES[encoding], "CompressedImage"
                values = _packed(pixels, encoding)
            else:
                suffix, kind, values = "", "Image", _raw(pixels, encoding)
            message = self._types.new("sensor_msgs", kind, header, *values)
            self._bag.write(topic + suffix, f"sensor_msgs/msg/{kind}", time_ns(time_s), message)
        info = self._types.camera_info(header, camera)
        topic, kind = "/camera/color/camera_info", "sensor_msgs/msg/CameraInfo"
        self._bag.write(topic, kind, time_ns(time_s), info)

    def close(self) -> None:
        """Complete the file."""
        self._bag.close()


def _raw(pixels: Pixels, encoding: str) -> tuple[Any, ...]:
    """The fields of an uncompressed image after its header."""
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    return *pixels.shape[:2], encoding, 0, pixels.strides[0], data


def _packed(pixels: Pixels, encoding: str) -> tuple[Any, ...]:
    """The fields of a compressed image after its header."""
    if encoding == "bgr8":
        return "bgr8; jpeg compressed bgr8", cv2.imencode(".jpg", pixels)[1].ravel()
    png = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].ravel()
    head = np.zeros(COMPRESSED_DEPTH_HEADER, np.uint8)
    return "16UC1; compressedDepth png", np.concatenate([head, png])


def record(folder: Path, frames: int, period_s: float, *, compressed: bool) -> Path:
    """Make a recording of the samples, one after the other."""
    samples: list[tuple[Pixels, Any, PinholeCamera]] = [
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
    """Measure rates and latency."""
    parser = program(__doc__)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2, help="threads of an inference")
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
        "machine": machine(),
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
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
