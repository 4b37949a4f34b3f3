"""Feed mutated files to every reader, in a process that may die.

    python tests/fuzz/fuzzing.py 100000     # cases; a second number is the seed, 0 by default

Each case starts from a seed of one format: a small valid file, or a file of ``corpus``. A reader
may return, or raise an error that is meant for the user. Anything else is a finding: another error,
more than 5 s of processor time, or more than 2 GiB of memory. The file of a finding is written to
``corpus``, whose files are read in every run.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import random
import resource
import sys
import tempfile
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

import calib
from edgetree.check.csv_file import read_csv
from edgetree.doctor.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.errors import EdgetreeError
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.detector import default_model

CORPUS = Path(__file__).with_name("corpus")
_LONGEST_S, _LARGEST_BYTES = 5, 2 * 2**30
_LONGEST_WAIT_S = 120  # for an answer, of a busy machine too
_ALLOWED = (calib.CalibError, EdgetreeError)
_TOKENS = (
    *(b"0", b"-1", b"1e300", b"1e-300", b"nan", b"inf", b"9" * 400, b"0x" + b"f" * 30, b"null"),
    *(b"[", b"]", b"{", b"}", b"<a>", b"</a>", b"&a ", b"*a", b"<<: ", b"!!int ", b"!!float "),
    *(b"? ", b"- ", b": ", b"\n---\n", b"\0", b'"', b"'", b"\\ud800", b"\xff\xff\xff\xff", b"\x80"),
)

_ROS = b"""image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [526.69, 0, 312.33, 0, 525.75, 246.22, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.01, -0.02, 0, 0, 0]}
"""
_OPENCV = b"""%YAML:1.0
---
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 905., 0., 640., 0., 904., 362., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -0.2, 0., 0., 0. ]
"""
_XML = b"""<?xml version="1.0"?><opencv_storage><image_width>1280</image_width>
<image_height>720</image_height><cameraMatrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols>
<data>905. 0. 640. 0. 904. 362. 0. 0. 1.</data></cameraMatrix>
<distCoeffs type_id="opencv-matrix"><rows>5</rows><cols>1</cols><data>0.1 0 0 0 0</data>
</distCoeffs></opencv_storage>"""
_KALIBR = b"""cam0: {camera_model: pinhole, intrinsics: [400, 400, 320, 240],
  resolution: [640, 480], distortion_model: equidistant, distortion_coeffs: [0.01, 0, 0, 0]}"""
_ZED = (
    b"[LEFT_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=0.1\nk2=0\n\n"
    b"[LEFT_DISTO]\nk1=0.1\nk2=0\np1=0\np2=0\nk3=0\n"
)
_REALSENSE = b"[ 640x480  p[320 240]  f[600 600]  Brown Conrady [0 0 0 0 0] ]"
_OWN = b'{"schema": "calib.camera/1", "width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320,'
_OWN += b' "cy": 240, "distortion": [0.1, 0, 0, 0]}'
_TRANSFORM = b'{"schema": "calib.transform/1", "translation_m": [0, 0, 1], "roll_pitch_yaw_deg":'
_TRANSFORM += b" [0, 10, 0]}"
_CSV = b"stem;diameter (cm);distance_m\n1;31,4;5\n2;20;\n"


class Format(NamedTuple):
    """A kind of file: valid ones, and the function that reads a path."""

    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]


class Finding(NamedTuple):
    """A file that a reader did not bear, and what happened."""

    format: str
    data: bytes
    problem: str


def _formats() -> dict[str, Format]:
    depth = np.arange(12, dtype=np.uint16).reshape(3, 4)
    pictures = tuple(
        cv2.imencode(suffix, depth.astype(np.uint8))[1].tobytes()
        for suffix in (".png", ".jpg", ".tif", ".bmp", ".webp")
    )
    header = b"\x93NUMPY\x01\x00F\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }"
    model = onnx_bytes(
        [Node("MatMul", ("x", "weights"), ("y",)), Node("Reshape", ("y", "n"), ("z",))],
        inputs={"x": TensorType("float32", ("batch", 4))},
        outputs={"z": TensorType("float32", ("batch", 3))},
        constants={"weights": np.ones((4, 3), np.float32), "n": np.array([1, 3])},
        metadata={"name": "small"},
    )
    manifest = read_model_file(default_model("depth")).metadata["edgetree.manifest"].encode()
    cameras = (_ROS, _OPENCV, _XML, _KALIBR, _ZED, _REALSENSE, _OWN)
    return {
        "camera": Format(cameras, calib.load_camera),
        "transform": Format((_TRANSFORM,), calib.load_transform),
        "depth.png": Format((cv2.imencode(".png", depth)[1].tobytes(),), calib.read_depth),
        "depth.npy": Format((header.ljust(79) + b"\n" + bytes(16),), calib.read_depth),
        "picture": Format(pictures, lambda path: calib.picture_size(path.read_bytes())),
        "model.onnx": Format((model,), read_model_file),
        "manifest": Format((manifest,), lambda path: Manifest.from_json(path.read_text("utf-8"))),
        "stems.csv": Format((_CSV,), read_csv),
    }


FORMATS = _formats()


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Change a file in one to four places."""
    content = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(content) + 1)
        end = min(len(content), at + rng.choice((0, 1, 1, 2, 8, 64)))
        how = rng.randrange(6)
        if how == 0 and at < len(content):
            content[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            del content[at:]
        elif how == 2:
            content[at:end] = content[at:end] * rng.choice((2, 3, 50))
        elif how == 3:
            content[at:end] = rng.randbytes(rng.randint(0, 4))
        else:
            content[at:end] = rng.choice(_TOKENS)
    return bytes(content)


def cases(count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Yield the corpus unchanged, then mutated files; (format, content)."""
    known = {name: list(form.seeds) for name, form in FORMATS.items()}
    for path in sorted(CORPUS.glob("*.bin")):
        name, data = path.name.split("-")[0], path.read_bytes()
        known[name].append(data)
        yield name, data
    rng = random.Random(seed)
    for _ in range(count):
        name = rng.choice(list(FORMATS))
        yield name, mutated(rng.choice(known[name]), rng)


def problem_of(name: str, data: bytes, folder: Path) -> str:
    """Read one file; return what went wrong, or an empty text."""
    path = folder / f"file-{name}"
    path.write_bytes(data)
    try:
        FORMATS[name].read(path)
    except _ALLOWED as error:
        return "a message of several lines" if "\n" in str(error) else ""
    except UnicodeDecodeError:
        return "" if name == "manifest" else "UnicodeDecodeError"
    except Exception as error:  # noqa: BLE001 - the finding
        return f"{type(error).__name__}: {error}"[:300]
    return ""


def _work(pipe: Connection) -> None:
    """Read files until told to stop, with limited memory."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries print what they find wrong
    resource.setrlimit(resource.RLIMIT_AS, (_LARGEST_BYTES, _LARGEST_BYTES))
    with tempfile.TemporaryDirectory() as folder:
        while (case := pipe.recv()) is not None:
            used_s = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
            allowed_s = used_s + _LONGEST_S + 1
            resource.setrlimit(resource.RLIMIT_CPU, (allowed_s, resource.RLIM_INFINITY))
            pipe.send(problem_of(*case, Path(folder)))


def fuzz(count: int, seed: int = 0) -> list[Finding]:
    """Read the corpus and ``count`` mutated files; return the findings.

    The workers are forks. Call it in a process of its own: a fork of a process with threads may
    wait for ever for a lock that one of them held.
    """
    context = multiprocessing.get_context("fork")
    findings: list[Finding] = []
    worker = None
    for name, data in cases(count, seed):
        if worker is None:
            pipe, other = context.Pipe()
            worker = context.Process(target=_work, args=(other,), daemon=True)
            worker.start()
            other.close()
        try:
            pipe.send((name, data))
            if not pipe.poll(_LONGEST_WAIT_S):
                worker.kill()
            problem = pipe.recv()
        except (EOFError, ConnectionError):
            worker.join()
            problem = f"the process ended with {worker.exitcode} (out of time or memory)"
            worker = None
        if problem:
            findings.append(Finding(name, data, problem))
    if worker is not None:
        pipe.send(None)
        worker.join()
    return findings


def main() -> None:
    """Fuzz as the command line says, and keep the files of findings."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    findings = {finding.problem: finding for finding in fuzz(count, seed)}.values()
    for finding in findings:
        digest = hashlib.sha256(finding.data).hexdigest()[:12]
        path = CORPUS / f"{finding.format}-{digest}.bin"
        path.write_bytes(finding.data)
        print(f"{path.name}: {finding.problem}")
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
