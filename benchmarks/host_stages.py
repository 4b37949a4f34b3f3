"""What a host does around the network, in the host and as operators of the graph.

python -m benchmarks.host_stages --result benchmarks/results/host_stages.json

Resizing, depth encoding and leaving out trees that a better one covers are measured as the Python
runtime does them. Resizing and encoding are measured as ONNX operators too, which could stand
before the network in the file: by the operator Resize, whose filter is another, and by halving,
which fits one size of frames. All are given as shares of the network's time, from rounds in turn.
Frames are the package's samples, 1280x720; models are `edge-n-depth` and `edge-n-rgb`, 640x384.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
from onnx import TensorProto, helper, numpy_helper

import calib
from benchmarks.tools.program import finish, machine, program
from benchmarks.tools.timing import in_turn
from edgetree import TreeDetector, sample_frames
from edgetree.catalogue import find_model
from edgetree.runtime.duplicates import distinct_trees
from edgetree.runtime.input_images import to_bytes
from edgetree.runtime.providers import import_onnxruntime

WIDTH, HEIGHT = 1280, 720


def session(nodes: list[Any], kind: int, shape: list[int], threads: int, **given: Any) -> Any:
    """A session on a graph from `frame` to uint8 `image`, with constants."""
    graph = helper.make_graph(
        nodes,
        "stages",
        [helper.make_tensor_value_info("frame", kind, shape)],
        [helper.make_tensor_value_info("image", TensorProto.UINT8, None)],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in given.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    ort = import_onnxruntime()
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return ort.InferenceSession(model.SerializeToString(), options, ["CPUExecutionProvider"])


def resize_session(channels: int, box: calib.Letterbox, pad_value: int, threads: int) -> Any:
    """Resizing and padding of (H, W, C) bytes by the operator Resize, for any size of frame."""
    node = helper.make_node
    resize = node("Resize", ["batch", "", "", "size"], ["small"], mode="linear", antialias=1)
    size = np.array([1, channels, box.resized_height, box.resized_width])
    return _resizing([resize], channels, box, pad_value, threads, size=size)


def halve_session(channels: int, box: calib.Letterbox, pad_value: int, threads: int) -> Any:
    """The same for frames of twice the size alone, with the host's result."""
    halve = helper.make_node(
        "AveragePool", ["batch"], ["small"], kernel_shape=[2, 2], strides=[2, 2]
    )
    return _resizing([halve], channels, box, pad_value, threads)


def _resizing(
    nodes: list[Any],
    channels: int,
    box: calib.Letterbox,
    pad_value: int,
    threads: int,
    **given: Any,
) -> Any:
    node = helper.make_node
    bottom, right = box.height - box.resized_height, box.width - box.resized_width
    return session(
        [
            node("Cast", ["frame"], ["float"], to=TensorProto.FLOAT),
            node("Transpose", ["float"], ["planes"], perm=[2, 0, 1]),
            node("Unsqueeze", ["planes", "first"], ["batch"]),
            *nodes,
            node("Pad", ["small", "pads", "pad_value"], ["padded"]),
            node("Add", ["padded", "half"], ["whole"]),
            node("Cast", ["whole"], ["bytes"], to=TensorProto.UINT8),
            node("Transpose", ["bytes"], ["image"], perm=[0, 2, 3, 1]),
        ],
        TensorProto.UINT8,
        [HEIGHT, WIDTH, channels],
        threads,
        first=np.array([0]),
        half=np.float32(0.5),
        pads=np.array([0, 0, 0, 0, 0, 0, bottom, right]),
        pad_value=np.float32(pad_value),
        **given,
    )


def encode_session(encoding: calib.DepthEncoding, threads: int) -> Any:
    """Metres (H, W) as greys; every reading is finite here."""
    node = helper.make_node
    nodes = [
        node("Mul", ["frame", "per_m"], ["scaled"]),
        node("Add", ["scaled", "offset"], ["grey"]),
        node("Clip", ["grey", "low", "high"], ["clipped"]),
        node("Round", ["clipped"], ["whole"]),
        node("Greater", ["frame", "zero"], ["reading"]),
        node("Where", ["reading", "whole", "invalid"], ["chosen"]),
        node("Cast", ["chosen"], ["image"], to=TensorProto.UINT8),
    ]
    per_m = (encoding.far_value - encoding.near_value) / (encoding.far_m - encoding.near_m)
    return session(
        nodes,
        TensorProto.FLOAT,
        [HEIGHT, WIDTH],
        threads,
        per_m=np.float32(per_m),
        offset=np.float32(encoding.near_value - encoding.near_m * per_m),
        low=np.float32(min(encoding.near_value, encoding.far_value)),
        high=np.float32(max(encoding.near_value, encoding.far_value)),
        zero=np.float32(0),
        invalid=np.float32(encoding.invalid_value),
    )


def stages_of(
    modality: str, threads: int
) -> tuple[list[dict[str, Callable[[], Any]]], dict[str, int]]:
    """The stages on each sample frame, by name; and the largest difference of each resizing."""
    detector = TreeDetector.load(find_model(f"edge-n-{modality}"), threads=threads)
    manifest, encoding = detector.manifest, None
    box = calib.Letterbox.fit(WIDTH, HEIGHT, manifest.input.width, manifest.input.height)
    pad_value = manifest.resize.pad_value
    if manifest.depth_encoding is not None:
        encoding = calib.DepthEncoding.from_dict(dict(manifest.depth_encoding))
    channels = 3 if encoding is None else 1
    resizing = {
        "resize, graph": resize_session(channels, box, pad_value, threads),
        "halve, graph": halve_session(channels, box, pad_value, threads),
    }
    encoder = None if encoding is None else encode_session(encoding, threads)
    frames, gaps = [], dict.fromkeys(resizing, 0)
    for sample in sample_frames():
        image = sample.image() if encoding is None else sample.depth_m()
        small = to_bytes(image, encoding)
        given = small.reshape(HEIGHT, WIDTH, -1)
        pixels = box.apply(small, pad_value)[None]
        inputs = detector.inputs_of(pixels)
        outputs = detector.session.run(inputs)
        rows = outputs["scores"][0] >= detector.score_threshold
        boxes, masks = outputs["boxes"][0][rows], outputs["masks"][0][rows]
        for name, graph in resizing.items():
            theirs = graph.run(None, {"frame": given})[0].reshape(pixels.shape)
            gaps[name] = max(gaps[name], int(np.abs(theirs.astype(int) - pixels).max()))
        stages: dict[str, Callable[[], Any]] = {
            "network": partial(detector.session.run, inputs),
            "resize, host": partial(box.apply, small, pad_value),
            **{
                name: partial(graph.run, None, {"frame": given}) for name, graph in resizing.items()
            },
            "covered trees, host": partial(
                distinct_trees, boxes, masks, manifest.thresholds.mask_overlap
            ),
        }
        if encoder is not None:
            stages["depth encoding, host"] = partial(to_bytes, image, encoding)
            stages["depth encoding, graph"] = partial(encoder.run, None, {"frame": image})
        frames.append(stages)
    return frames, gaps


def measure(modality: str, threads: int, rounds: int) -> dict[str, Any]:
    """Median time of each stage, and its share of the network's."""
    frames, gaps = stages_of(modality, threads)
    calls = {
        name: lambda number, name=name: frames[number % len(frames)][name]() for name in frames[0]
    }
    times_ms = in_turn(calls, rounds, warm_up=2)
    medians = {name: statistics.median(values) for name, values in times_ms.items()}
    return {
        "stages": {
            name: {"ms": round(ms, 3), "share": round(ms / medians["network"], 4)}
            for name, ms in medians.items()
        },
        "largest_grey_difference": gaps,
    }


def main() -> None:
    """Measure the stages of both packaged models."""
    parser = program(__doc__)
    parser.add_argument("--rounds", type=int, default=120)
    parser.add_argument("--threads", type=int, default=2, help="threads of an inference")
    arguments = parser.parse_args()
    cv2.setNumThreads(arguments.threads)
    result = {
        "machine": machine(),
        "onnxruntime": import_onnxruntime().__version__,
        "threads": arguments.threads,
        "frame": f"{WIDTH}x{HEIGHT}",
        "models": {
            modality: measure(modality, arguments.threads, arguments.rounds)
            for modality in ("rgb", "depth")
        },
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
