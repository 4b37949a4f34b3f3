"""Effect of the preset `field` and its groups on a light RGB network, against `paper`.

python -m benchmarks.field WORK --tests TEST,FIELD_TEST --pictures PICTURES/instances.json \
    --mixes paper-0,field-0,paper-1,field-1,none,scene,camera,objects,colours,trap,negatives \
    --result FILE.json

`paper-N` and `field-N` train for `--minutes` with seed N. Each group of `FIELD_GROUPS` is
added to `paper` alone and trained for half the time on a quarter of the frames, as is `none`,
which is `paper`; these short runs give hints, not decisions. Every network starts from the same
weights (`--start`, by default random). It is evaluated on the test split of each of TESTS
and on the real pictures. WORK keeps datasets (640x360 px, four views per scene), runs
and scores. Existing ones are reused, so that mixes can run in several single-threaded processes
(`OMP_NUM_THREADS=1`).
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from benchmarks.tools.program import finish, made_once, note, program
from benchmarks.tools.scores import NEVER, scores
from benchmarks.transfer import on_pictures
from perceptree.models import load_checkpoint, make_spec
from perceptree.simulator import CameraSettings, SimulatorSettings, generate_dataset
from perceptree.simulator.settings.field import FIELD_GROUPS, with_groups
from perceptree.simulator.settings.presets import PRESETS
from perceptree.training import recipe_settings, train

SEED = 301
VIEWS = 4
WIDTH_PX, HEIGHT_PX = 640, 360
RATE = 1.5e-3
NONE = "none"


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
    minutes = arguments.minutes / (1 if whole else 2)
    data, folder = arguments.work / "data" / mix, arguments.work / "runs" / name

    def trained() -> dict[str, Any]:
        note(f"{name}: simulating")
        generate_dataset(data, frames, settings_of(mix), SEED, workers=arguments.workers)
        note(f"{name}: training")
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
        model = load_checkpoint(report.checkpoint)[0].eval()
        return {
            "minutes": minutes,
            "frames": frames,
            "steps": report.steps,
            **{
                Path(test).name: scores(report.checkpoint, Path(test))
                for test in arguments.tests.split(",")
            },
            "real pictures": on_pictures(model, arguments.pictures),
        }

    found = made_once(folder / "scores.json", trained)
    note(f"{name}: {found}")
    return found


def main() -> None:
    """Run the missing mixes, and optionally write the table."""
    parser = program(__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--tests", required=True, help="folders of test sets, separated by commas")
    parser.add_argument("--pictures", type=Path, required=True)
    parser.add_argument("--mixes", required=True)
    parser.add_argument("--frames", type=int, default=1200)
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--start", type=Path, help="common starting checkpoint; default: random")
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
        finish(result | {"rows": rows}, arguments.result)


if __name__ == "__main__":
    main()
