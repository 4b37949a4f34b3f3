"""Effect of single changes of the training recipe `scratch` on a light network.

python -m benchmarks.scratch DATA --start CHECKPOINT --test TEST --runs RUNS --minutes 30 \
    --candidates base-0,base-1,colours,paste --result benchmarks/results/scratch_rgb.json

Every candidate starts from the same checkpoint and trains for the same time, with the learning rate
decreasing to zero. Its averaged weights are evaluated on the test split of TEST. `base-N` is the
unchanged recipe with seed N; the differences between the bases show the noise that the effect of a
change must exceed. Finished runs in RUNS are reused, so that candidates can run one after another,
or in several single-threaded processes (`OMP_NUM_THREADS=1`). A final call with all names writes
the result.
"""

from __future__ import annotations

import argparse
import platform
from pathlib import Path
from typing import Any

import torch

from benchmarks.tools.program import finish, made_once, note, program
from benchmarks.tools.scores import MEASURES, NEVER, scores
from perceptree.data import AugmentSettings, read_split
from perceptree.models import load_checkpoint
from perceptree.training import TrainSettings, recipe_settings, train

RATE = 1e-3
BASE = "base-"
CANDIDATES: dict[str, tuple[str, dict[str, Any]]] = {
    "colours": (
        "strong colours: shadows, hue, curves, blur, patches, chroma noise, JPEG",
        {
            "augment": AugmentSettings(
                shadow=0.6,
                vignette=0.5,
                hue_deg=20,
                grey_share=0.05,
                curves=0.4,
                channel_shuffle_share=0.05,
                blur_share=0.5,
                blur_px=1.5,
                motion_blur_px=6,
                sharpening=1,
                cutouts=4,
                chroma_noise=5,
                jpeg_share=0.3,
            )
        },
    ),
    "faults": (
        "faults of depth sensors: far noise and steps, range, occlusion shadows, holes",
        {
            "augment": AugmentSettings(
                far_noise_m=0.3,
                far_step_m=0.5,
                range_loss=0.4,
                stereo_px_m=35,
                edge_loss_px=3,
                hole_area=0.1,
            )
        },
    ),
    "paste": (
        "one to three trees of another frame pasted into half of the frames",
        {"augment": AugmentSettings(copy_paste_share=0.5)},
    ),
    "average": ("weights averaged over 5 times as many steps", {"ema_decay": 0.9996}),
}


def settings_of(name: str, minutes: float) -> TrainSettings:
    """Training settings of the recipe with a candidate's change."""
    changes: dict[str, Any] = {
        "minutes": minutes,
        "learning_rate": RATE,
        "schedule": "decay",
        "evaluate_every_steps": NEVER,
    }
    if name.startswith(BASE):
        changes["seed"] = int(name.removeprefix(BASE))
    else:
        changes |= CANDIDATES[name][1]
    return recipe_settings("scratch", **changes)


def run(name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Train and evaluate one candidate, or read the scores of an earlier run."""
    folder: Path = arguments.runs / name

    def trained() -> dict[str, Any]:
        spec = load_checkpoint(arguments.start)[0].spec
        settings = settings_of(name, arguments.minutes)
        report = train(spec, settings, arguments.data, folder, init=arguments.start)
        return scores(report.checkpoint, arguments.test) | {
            "steps": report.steps,
            "frames": report.steps * settings.batch,
            "elapsed_s": round(report.elapsed_s, 1),
        }

    found = made_once(folder / "scores.json", trained)
    note(f"{name}: {found}")
    return found


def main() -> None:
    """Train the missing candidates, and optionally write the table."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--start", type=Path, required=True, help="common starting checkpoint")
    parser.add_argument("--test", type=Path, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--candidates", required=True, help=f"base-N, {', '.join(CANDIDATES)}")
    arguments = parser.parse_args()
    names = arguments.candidates.split(",")
    rows = {name: run(name, arguments) for name in names}
    if arguments.result is None:
        return
    bases = [row for name, row in rows.items() if name.startswith(BASE)]
    spread = {
        measure: max(row[measure] for row in bases) - min(row[measure] for row in bases)
        for measure in MEASURES
    }
    start_model = load_checkpoint(arguments.start)[0]
    result = {
        "machine": platform.machine(),
        "threads": torch.get_num_threads(),
        "modality": start_model.spec.modality,
        "train frames": len(read_split(arguments.data, "train")),
        "test frames": len(read_split(arguments.test, "test")),
        "minutes": arguments.minutes,
        "start": scores(arguments.start, arguments.test),
        "what": {name: CANDIDATES[name][0] for name in names if name in CANDIDATES},
        "rows": rows,
        "spread of the bases": spread,
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
