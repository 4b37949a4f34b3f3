"""Overhead of the runtime: its start, and the work around each inference.

python -m benchmarks.runtime --result benchmarks/results/runtime.json

The start is measured in new processes, alternating with one that only imports numpy, OpenCV and
onnxruntime. The work around the network (resizing, depth encoding, decoding the output) is the time
of `detect` minus that of the session's `run` in the same call. Pasting the masks of ten trees and
decoding image files are measured separately. Frames are the package's samples, 1280x720; models are
`edge-n-depth` and `edge-n-rgb`, 640x384. On a machine with other load, ratios are valid, absolute
times are not.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from functools import partial

import cv2
import numpy as np

from benchmarks.tools.program import finish, machine, program
from benchmarks.tools.timing import medians, time_ms
from edgetree import SampleFrame, TreeDetections, TreeDetector, sample_frames
from edgetree.catalogue import find_model
from edgetree.runtime.providers import SessionSettings, import_onnxruntime
from edgetree.runtime.session import Arrays, OrtSession

TARGETS = {"import_s": 0.3, "first_result_s": 1.5, "around_and_paste_share": 0.1}
PASTED = 10

BARE = """
import time
start = time.perf_counter()
import numpy, cv2, onnxruntime
print([time.perf_counter() - start])
"""
OURS = """
import sys, time
start = time.perf_counter()
import edgetree.runtime.detector as runtime
from edgetree.catalogue import find_model
imported = time.perf_counter()
import numpy as np
frame = np.zeros((720, 1280, 3) if sys.argv[1] == "rgb" else (720, 1280), np.uint8)
begin = time.perf_counter()
detector = runtime.TreeDetector.load(find_model("edge-n-" + sys.argv[1]), threads=int(sys.argv[2]))
loaded = time.perf_counter()
detector.detect(frame)
done = time.perf_counter()
print([imported - start, loaded - begin, done - begin])
"""


def run_fresh(code: str, *arguments: str) -> list[float]:
    """Run a program in a new process, and return what it prints."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    times_s: list[float] = json.loads(done.stdout)
    return times_s


def measure_start(modality: str, threads: int, rounds: int) -> dict[str, float]:
    """Measure import, loading and first result, alternating with the imports of the libraries."""
    rows = []
    for _ in range(rounds):
        (bare_s,) = run_fresh(BARE)
        import_s, load_s, first_s = run_fresh(OURS, modality, str(threads))
        rows.append(
            {
                "bare_import_s": bare_s,
                "import_s": import_s,
                "load_s": load_s,
                "first_result_s": first_s,
                "import_and_load_to_bare_import": (import_s + load_s) / bare_s,
            }
        )
    return medians(rows)


class TimedSession(OrtSession):
    """A session that records the time of its last `run`."""

    run_ms = 0.0

    def run(self, inputs: Arrays) -> dict[str, np.ndarray]:
        """All outputs by name."""
        start = time.perf_counter()
        outputs = super().run(inputs)
        self.run_ms = (time.perf_counter() - start) * 1000
        return outputs


def paste_all(trees: TreeDetections) -> None:
    """Paste all masks, one after the other."""
    for tree in range(len(trees)):
        trees.mask(tree)


def measure_around(modality: str, threads: int, rounds: int) -> dict[str, float]:
    """Measure `detect`, the `run` inside it, and the pasting of ten masks, over the samples."""
    session = TimedSession(find_model(f"edge-n-{modality}"), SessionSettings(threads=threads))
    detector = TreeDetector(session, score_threshold=0.0)
    detector.warm_up()
    frames = [frame.image() if modality == "rgb" else frame.depth_m() for frame in sample_frames()]
    rows = []
    for index in range(rounds):
        frame = frames[index % len(frames)]
        detect_ms = time_ms(partial(detector.detect, frame))
        run_ms = session.run_ms
        trees = detector.detect(frame)
        ten = trees.select(np.arange(PASTED) % len(trees))
        paste_ms = time_ms(partial(paste_all, ten))
        rows.append(
            {
                "run_ms": run_ms,
                "around_ms": detect_ms - run_ms,
                "paste_ten_ms": paste_ms,
                "around_share": (detect_ms - run_ms) / run_ms,
                "around_and_paste_share": (detect_ms - run_ms + paste_ms) / run_ms,
            }
        )
    return medians(rows)


def measure_decoding(frame: SampleFrame, rounds: int) -> dict[str, float]:
    """Measure decoding one 1280x720 frame from memory."""
    jpeg = np.frombuffer(frame.image_path.read_bytes(), np.uint8)
    png = cv2.imencode(".png", frame.image())[1]
    depth_png = np.frombuffer(frame.depth_path.read_bytes(), np.uint8)
    return medians(
        [
            {
                "jpeg_ms": time_ms(lambda: cv2.imdecode(jpeg, cv2.IMREAD_COLOR)),
                "png_ms": time_ms(lambda: cv2.imdecode(png, cv2.IMREAD_COLOR)),
                "depth_png_ms": time_ms(lambda: cv2.imdecode(depth_png, cv2.IMREAD_UNCHANGED)),
            }
            for _ in range(rounds)
        ]
    )


def main() -> None:
    """Measure both packaged models."""
    parser = program(__doc__)
    parser.add_argument("--rounds", type=int, default=60, help="detections per model")
    parser.add_argument("--starts", type=int, default=7, help="new processes per model")
    parser.add_argument("--threads", type=int, default=1, help="threads of an inference")
    arguments = parser.parse_args()
    cv2.setNumThreads(arguments.threads)
    models = {
        modality: measure_start(modality, arguments.threads, arguments.starts)
        | measure_around(modality, arguments.threads, arguments.rounds)
        for modality in ("rgb", "depth")
    }
    result = {
        "machine": machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "threads": arguments.threads,
        "frame": "1280x720",
        "models": models,
        "decoding": measure_decoding(sample_frames()[0], arguments.rounds),
        "targets": TARGETS,
        "missed": [
            f"{modality} {name}"
            for modality, figures in models.items()
            for name, limit in TARGETS.items()
            if figures[name] > limit
        ],
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
