"""Exported networks compared with torchvision's export, and the light models in the runtime.

python benchmarks/export.py --checkpoint R50.safetensors --test DATASET --data DATASET \
    --result benchmarks/results/export.json

torchvision's Mask and Keypoint R-CNN with R50-FPN, exported by its own exporter, alternates with
this project's R50 in float32 and INT8, with only the R50's backbone and pyramid in float32, and
with `TreeDetector.detect` for the light models. All process one sample frame. The R50 models run
at 800x800 with 20 computed detections, timed from the input array to the output arrays.
torchvision's output includes masks of the frame's size; this project's does not.

Without a checkpoint the R50 has random weights that give as many detections as trained ones. With
--test, the average precision of its files is compared too. Ratios are medians of ratios within a
round, so that they are valid on a machine with other load. Existing files in --models are reused;
remove them after a change of the export.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch
import torchvision
from export_files import ALL_PROPOSALS, SIDE_PX, build, calibration_frames, note, our_model, spread
from numpy.typing import NDArray

from basetree.errors import EdgetreeError, InputError
from basetree.files.writing import output_folder
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.doctor.machine import examine_machine
from edgetree.export.frames import sample_inputs
from edgetree.runtime.providers import SessionSettings
from edgetree.runtime.session import OrtSession, usable_cores
from perceptree.data import FrameStore, read_split
from perceptree.evaluation import RawDetections, evaluate
from perceptree.models import TreeRCNN, make_spec

OURS = ("float32", "int8")  # prefixes of the names of this project's files at 800x800
LOADS, EDGE_CALLS = 3, 10
SETTLE_S = 0.2  # idle spinning threads sleep after this time
TARGETS = {
    "torchvision_to_float32": 1.2,
    "torchvision_to_int8": 4.0,
    "edge_to_trunk": 0.07,
    "edge_fps": 36.0,  # reached if this one or the one above is
    "box_ap_loss": 0.5,
}

Times = dict[str, list[list[float]]]


@dataclass(frozen=True)
class Contestant:
    """A loaded file, the call to time, its repeats in a row, and facts for the report."""

    path: Path
    load_ms: float
    session: OrtSession
    run: Callable[[], object]
    calls: int = 1
    about: dict[str, Any] = field(default_factory=dict)


def inputs_at_side(model: TreeRCNN) -> dict[str, NDArray[Any]]:
    """The first sample frame, letterboxed, as each kind of file takes it."""
    ours = sample_inputs(model.spec)[:1]
    colour = make_spec("r50", "rgb", SIDE_PX, SIDE_PX, pad_value=model.spec.pad_value)
    rgb = sample_inputs(colour)[0][..., ::-1].transpose(2, 0, 1)
    return {
        "torchvision": np.ascontiguousarray(rgb).astype(np.float32) / 255,
        "trunk": np.ascontiguousarray(model.normalise(torch.from_numpy(ours)).numpy()),
        "ours": ours,
    }


def loaded(load: Callable[[], Any]) -> tuple[Any, float]:
    """The loaded object, and the median time to load it, ms."""
    times = []
    for _ in range(LOADS):
        start = time.perf_counter()
        result = load()
        times.append((time.perf_counter() - start) * 1000)
    return result, statistics.median(times)


def networks(files: dict[str, Path], inputs: dict[str, NDArray[Any]]) -> dict[str, Contestant]:
    """The files at 800x800 with spinning threads, each with its frame."""
    settings = SessionSettings(spinning=True)
    found = {}
    for name, path in files.items():
        session, load_ms = loaded(partial(OrtSession, path, settings))
        feed = {"image": inputs.get(name, inputs["ours"])}
        found[name] = Contestant(path, load_ms, session, partial(session.run, feed))
    return found


def edge_models(paths: list[Path]) -> dict[str, Contestant]:
    """The light models in the runtime, with its default settings and with spinning threads."""
    frame = sample_frames()[0]
    images = {"rgb": frame.image(), "depth": frame.depth_m()}
    found = {}
    for path in paths:
        for spinning in (False, True):
            detector, load_ms = loaded(partial(TreeDetector.load, path, spinning=spinning))
            manifest = detector.manifest
            about = {
                "model": manifest.name,
                "precision": manifest.precision,
                "input": f"{manifest.input.width}x{manifest.input.height}",
                "spinning": spinning,
            }
            run = partial(detector.detect, images[manifest.modality])
            found[path.name + " spinning" * spinning] = Contestant(
                path, load_ms, detector.session, run, EDGE_CALLS, about
            )
    return found


def take_turns(contestants: dict[str, Contestant], rounds: int) -> Times:
    """Times by contestant and round, ms, without the warm-up calls."""
    times: Times = {name: [] for name in contestants}
    for turn in range(rounds + 1):
        note(f"round {turn} of {rounds}")
        for name, contestant in contestants.items():
            taken = []
            for _ in range(contestant.calls):
                start = time.perf_counter()
                contestant.run()
                taken.append((time.perf_counter() - start) * 1000)
            if turn:
                times[name].append(taken[1:] or taken)
            time.sleep(SETTLE_S)
    return times


def ratio(times: Times, above: str, below: str) -> float:
    """Median over the rounds of the ratio of two contestants' times."""
    pairs = zip(times[above], times[below], strict=True)
    return round(
        statistics.median(statistics.median(a) / statistics.median(b) for a, b in pairs), 4
    )


def row(contestant: Contestant, times: list[list[float]]) -> dict[str, Any]:
    """Facts and times of one file."""
    every = [taken for of_round in times for taken in of_round]
    return {
        **contestant.about,
        "median_ms": round(statistics.median(every), 2),
        "p90_ms": round(float(np.percentile(every, 90)), 2),
        "load_ms": round(contestant.load_ms, 1),
        "file_mib": round(contestant.path.stat().st_size / 1024**2, 2),
    }


def accuracy(session: OrtSession, store: FrameStore) -> dict[str, float | None]:
    """Average precision of a file in percent."""

    def predict(images: NDArray[np.uint8]) -> RawDetections:
        found = session.run({"image": images})
        return RawDetections(
            found["boxes"],
            found["scores"],
            found.get("keypoints"),
            found.get("masks"),
            found["num_detections"],
        )

    metrics = evaluate(predict, store)
    values = {name: getattr(metrics, name) for name in ("box_ap", "mask_ap", "keypoint_ap")}
    return {name: None if value is None else round(value, 2) for name, value in values.items()}


def accuracies(contestants: dict[str, Contestant], test: Path, model: TreeRCNN, most: int) -> Any:
    """Average precision of each file, and its loss against float32 with all proposals."""
    store = FrameStore(spread(read_split(test, "test"), most), model.spec)
    found: dict[str, Any] = {"frames": len(store), "trees": store.trees}
    for name, contestant in contestants.items():
        if name.startswith(OURS):
            note(f"evaluating {name} on {len(store)} frames")
            found[name] = accuracy(contestant.session, store)
            full = found[f"float32-{ALL_PROPOSALS}"]
            found[name] |= {
                f"{measure}_loss": round(full[measure] - value, 2)
                for measure, value in found[name].items()
                if value is not None
            }
    return found


def missed(ratios: dict[str, float], edge: dict[str, Any], precision: dict[str, Any]) -> list[str]:
    """The missed targets; for the light models, with the runtime's default settings."""
    found = [name for name in ratios if ratios[name] < TARGETS[name]]
    found += [
        f"{name} edge_to_trunk and edge_fps"
        for name, figures in edge.items()
        if not figures["spinning"]
        and figures["to_trunk"] > TARGETS["edge_to_trunk"]
        and figures["fps"] < TARGETS["edge_fps"]
    ]
    found += [
        f"{name} box_ap_loss"
        for name, figures in precision.items()
        if isinstance(figures, dict) and figures["box_ap_loss"] > TARGETS["box_ap_loss"]
    ]
    return found


def measure(arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Run all measurements."""
    model, trained_on, weights = our_model(arguments.checkpoint)
    data = arguments.data or arguments.test
    shown = calibration_frames(model, data, arguments.calibration)
    files = build(model, weights, shown, arguments.proposals, folder)
    heavy = networks(files, inputs_at_side(model))
    edge = edge_models(arguments.edge)
    times = take_turns(heavy | edge, arguments.rounds)
    rows = {name: row(each, times[name]) for name, each in (heavy | edge).items()}
    for name in (name for name in heavy if name.startswith(OURS)):
        rows[name]["torchvision_to_this"] = ratio(times, "torchvision", name)
    for name in edge:
        rows[name]["fps"] = round(1000 / rows[name]["median_ms"], 1)
        rows[name]["to_trunk"] = ratio(times, name, "trunk")
    edge_rows = {name: rows[name] for name in edge}
    ratios = {
        "torchvision_to_float32": rows[f"float32-{arguments.proposals}"]["torchvision_to_this"],
        "torchvision_to_int8": rows[f"int8-{arguments.proposals}"]["torchvision_to_this"],
    }
    precision = {}
    if arguments.test:
        precision = accuracies(heavy, arguments.test, model, arguments.frames)
    return {
        "network": {"name": model.spec.name, "trained_on": trained_on, "input": "800x800"},
        "calibration_frames": len(shown),
        "calibrated_on": data.name if data else "samples",
        "rounds": arguments.rounds,
        "files": {name: rows[name] for name in heavy},
        "edge": edge_rows,
        "ratios": ratios,
        "average_precision": precision,
        "targets": TARGETS,
        "missed": missed(ratios, edge_rows, precision),
    }


def parse(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Parse and check the command line."""
    parser.add_argument("--checkpoint", type=Path, help="R50 checkpoint; default: untrained")
    parser.add_argument("--edge", type=Path, nargs="+", help="light models; default: the package's")
    parser.add_argument("--test", type=Path, help="dataset for the average precision")
    parser.add_argument("--frames", type=int, default=100, help="maximum number of test frames")
    parser.add_argument("--data", type=Path, help="calibration data; default: --test's")
    parser.add_argument("--calibration", type=int, default=64, help="number of calibration frames")
    parser.add_argument(
        "--proposals", type=int, default=300, help="proposals of the faster exports"
    )
    parser.add_argument("--models", type=Path, help="folder to keep the exported files in")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--result", type=Path)
    arguments = parser.parse_args()
    for name in ("frames", "calibration", "rounds"):
        if getattr(arguments, name) < 1:
            parser.error(f"--{name} is {getattr(arguments, name)}: expected 1 or more")
    if arguments.result and not arguments.result.parent.is_dir():
        parser.error(f"--result is {arguments.result}: expected a file in a folder that is there")
    if arguments.test and not arguments.checkpoint:
        parser.error(
            "--test without --checkpoint: expected both, as untrained networks find nothing"
        )
    arguments.edge = arguments.edge or [default_model("rgb"), default_model("depth")]
    if len({path.name for path in arguments.edge}) < len(arguments.edge):
        parser.error("--edge has two files of one name: expected different names")
    return arguments


def main() -> None:
    """Print the results as JSON, and optionally write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    arguments = parse(parser)
    kept = arguments.models
    try:
        with output_folder(kept) if kept else tempfile.TemporaryDirectory() as folder:
            figures = measure(arguments, Path(folder))
    except (EdgetreeError, InputError) as error:
        parser.error(str(error))
    machine = examine_machine()
    result = {
        "machine": machine.processor,
        "instructions": machine.instructions,
        "threads": usable_cores(),
        "onnxruntime": onnxruntime.__version__,
        "torch": torch.__version__,
        "torchvision": torchvision.__version__,
        **figures,
    }
    text = json.dumps(result, indent=2)
    sys.stdout.write(text + "\n")
    if arguments.result:
        arguments.result.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
