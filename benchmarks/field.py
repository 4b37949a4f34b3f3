"""Effect of the preset ``field`` and its groups on a light RGB network, against ``paper``.

python benchmarks/field.py WORK --tests TEST,FIELD_TEST --pictures PICTURES/instances.json \
    --mixes paper-0,field-0,paper-1,field-1,none,scene,camera,objects,colours,trap,negatives \
    --result FILE.json

``paper-N`` and ``field-N`` train for ``--minutes`` with seed N. Each group of ``FIELD_GROUPS`` is
added to ``paper`` alone and trained for half the time on a quarter of the frames, as is ``none``,
which is ``paper``; these short runs give hints, not decisions. Every network starts from the same
weights (``--start``, by default random). It is evaluated on the test split of each of TESTS and, as
a float32 file, on the real pictures. WORK keeps datasets (640x360 px, four views per scene), runs
and scores. Existing ones are reused, so that mixes can run in several single-threaded processes
(``OMP_NUM_THREADS=1``).
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from perceptree.data import FrameStore, read_split
from perceptree.evaluation import evaluate, predict_with
from perceptree.models import load_checkpoint, make_spec
from perceptree.simulator import CameraSettings, SimulatorSettings, generate_dataset
from perceptree.simulator.settings.field import FIELD_GROUPS, with_groups
from perceptree.simulator.settings.presets import PRESETS
from perceptree.training import recipe_settings, train

SEED = 301
VIEWS = 4
WIDTH_PX, HEIGHT_PX = 640, 360
RATE = 1.5e-3
NEVER = 10**9
NONE = "none"
MEASURES = ("box_ap", "mask_ap", "keypoint_ap", "diameter_error_px", "recall", "precision")


def settings_of(mix: str) -> SimulatorSettings:
    """Settings of the paper, of the field, or of the paper with one group."""
    paper = PRESETS["paper"].settings
    groups = [mix] if mix in FIELD_GROUPS else []
    chosen = PRESETS["field"].settings if mix == "field" else with_groups(paper, groups)
    camera = dataclasses.replace(
        chosen.camera, intrinsics=CameraSettings.of_size(WIDTH_PX, HEIGHT_PX).intrinsics
    )
    return dataclasses.replace(chosen, camera=camera, splits=paper.splits, views_per_scene=VIEWS)


def run(name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Simulate, train and evaluate one mix, or read the scores of an earlier run."""
    mix, _, seed = name.partition("-")
    whole = mix in ("paper", "field")
    frames = arguments.frames if whole else arguments.frames // 4
    data = arguments.work / "data" / mix
    folder = arguments.work / "runs" / name
    found = folder / "scores.json"
    if found.exists():
        return dict(json.loads(found.read_text("utf-8")))
    sys.stderr.write(f"{name}: simulating\n")
    generate_dataset(data, frames, settings_of(mix), SEED, workers=arguments.workers)
    sys.stderr.write(f"{name}: training\n")
    minutes = arguments.minutes / (1 if whole else 2)
    settings = recipe_settings(
        "scratch",
        minutes=minutes,
        learning_rate=RATE,
        schedule="decay",
        evaluate_every_steps=NEVER,
        seed=int(seed or 0),
    )
    start = arguments.start
    spec = make_spec("edge-n", "rgb") if start is None else load_checkpoint(start)[0].spec
    report = train(spec, settings, data, folder, init=start)
    scores: dict[str, Any] = {"minutes": minutes, "frames": frames, "steps": report.steps}
    model = load_checkpoint(report.checkpoint)[0].eval()
    for test in arguments.tests.split(","):
        store = FrameStore(read_split(Path(test), "test"), model.spec)
        metrics = evaluate(predict_with(model), store, 4).to_dict()
        scores[Path(test).name] = {measure: metrics[measure] for measure in MEASURES}
    scores["real pictures"] = real(report.checkpoint, data, folder, arguments.pictures)
    found.write_text(json.dumps(scores), "utf-8")
    sys.stderr.write(f"{name}: {scores}\n")
    return scores


def real(checkpoint: Path, data: Path, folder: Path, pictures: Path) -> dict[str, Any]:
    """Evaluate the float32 file on the annotated pictures, and draw the detections."""
    file = folder / "model.onnx"
    subprocess.run(
        ["edgetree", "export", str(checkpoint), "--data", str(data), "--out", str(file)], check=True
    )
    script = Path(__file__).with_name("real_pictures.py")
    told = subprocess.run(
        [
            sys.executable,
            str(script),
            str(pictures),
            "--model",
            str(file),
            "--drawn",
            str(folder / "real"),
        ],
        check=True,
        capture_output=True,
        text=True,
    )
    scores = dict(json.loads(told.stdout))
    del scores["model"]
    return scores


def main() -> None:
    """Run the missing mixes, and optionally write the table."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("work", type=Path)
    parser.add_argument("--tests", required=True, help="folders of test sets, separated by commas")
    parser.add_argument("--pictures", type=Path, required=True)
    parser.add_argument("--mixes", required=True)
    parser.add_argument("--frames", type=int, default=1200)
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--start", type=Path, help="common starting checkpoint; default: random")
    parser.add_argument("--result", type=Path)
    arguments = parser.parse_args()
    for name in arguments.mixes.split(","):
        mix = name.partition("-")[0]
        if mix not in ("paper", "field", NONE, *FIELD_GROUPS):
            parser.error(
                f"--mixes names {mix!r}: expected paper-N, field-N, {NONE} or one of"
                f" {', '.join(FIELD_GROUPS)}"
            )
    rows = {name: run(name, arguments) for name in arguments.mixes.split(",")}
    if arguments.result is not None:
        result = {"start": arguments.start and arguments.start.name}
        arguments.result.write_text(json.dumps(result | {"rows": rows}, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
