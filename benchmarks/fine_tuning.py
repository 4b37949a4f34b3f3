"""Fine-tuning on a hundred labelled pictures of another forest, as the guide describes it.

python -m benchmarks.fine_tuning CHECKPOINT WORK --general DATA --test TEST_SET --result FILE.json

The other forest is simulated: dense old beeches and maples on snowy slopes in fog, rain and snow at
dusk, seen from a high mast through a wide lens with distortion, none of which the presets contain
in this combination. Of its hundred pictures, each of another place, some 85 train and the others
choose the weights. AP is measured before and after on 200 more pictures of that forest and on the
frozen test set. Half of each batch comes from DATA, a folder of ``perceptree synth --preset
field``. WORK keeps datasets and runs; an interrupted call is resumed.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.tools.program import finish, note, program
from benchmarks.tools.scores import scores
from calib import PinholeCamera
from perceptree.models import load_checkpoint
from perceptree.simulator import (
    CameraSettings,
    LightSettings,
    PoseSettings,
    SimulatorSettings,
    SplitSettings,
    StandSettings,
    TerrainSettings,
    WeatherSettings,
    generate_dataset,
)
from perceptree.training import DataSource, recipe_settings, train

PICTURES = 100
TEST_PICTURES = 200
SEED, TEST_SEED = 501, 502
RATE = 5e-4
MIX_SHARE = 0.5
FINAL_SHARE = 0.3


def other_forest() -> SimulatorSettings:
    """Settings of a forest, a camera and a weather unlike those of the presets."""
    mast = PoseSettings((3.5, 4.5), (-30.0, -15.0), (-3.0, 3.0))
    lens = PinholeCamera(768, 480, 330.0, 330.0, 384.0, 250.0, (-0.16, 0.02, 0.0, 0.0))
    return SimulatorSettings(
        terrain=TerrainSettings(slope_deg=(10.0, 30.0), grounds={"mud": 1.0, "roots": 1.0}),
        stand=StandSettings(
            stems_per_ha=(700.0, 1400.0),
            species={"beech": 2.0, "maple": 1.0},
            species_per_scene=2,
            diameter_median_m=(0.3, 0.45),
            lean_std_deg=(5.0, 10.0),
            fork_share=0.3,
            fine_crowns=True,
        ),
        weather=WeatherSettings(
            kinds={"snow": 1.0, "fog": 1.0, "rain": 1.0, "snowfall": 1.0}, strength=(0.5, 1.0)
        ),
        light=LightSettings(times={"evening": 1.0, "dusk": 2.0}, overcast_share=0.7),
        camera=CameraSettings(lens, mast=mast, mast_share=1.0),
        views_per_scene=1,
    )


def simulate(work: Path) -> tuple[Path, Path]:
    """Simulate the pictures to train on and those to measure on; return their folders."""
    pictures, unseen = work / "pictures", work / "unseen"
    forest = other_forest()
    split = replace(forest, splits=SplitSettings(val=0.15, test=0.0))
    generate_dataset(pictures, PICTURES, split, SEED)
    held_out = replace(forest, splits=SplitSettings(val=0.0, test=1.0))
    generate_dataset(unseen, TEST_PICTURES, held_out, TEST_SEED)
    return pictures, unseen


def main() -> None:
    """Simulate, measure, fine-tune and measure again."""
    parser = program(__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--general", type=Path, required=True, help="simulated frames to mix in")
    parser.add_argument("--test", type=Path, required=True, help="the frozen test set")
    parser.add_argument("--minutes", type=float, default=60)
    arguments = parser.parse_args()
    pictures, unseen = simulate(arguments.work)
    tests = {"other forest": unseen, "test": arguments.test}
    before = {name: scores(arguments.checkpoint, test) for name, test in tests.items()}
    note(f"before: {before}")
    spec = load_checkpoint(arguments.checkpoint)[0].spec
    source = DataSource(pictures, mix=arguments.general)
    shared: dict[str, Any] = {"mix_share": MIX_SHARE, "learning_rate": RATE}
    tuned, final = arguments.work / "tuned", arguments.work / "tuned-final"
    minutes = arguments.minutes * (1 - FINAL_SHARE)
    first = recipe_settings("scratch", minutes=minutes, **shared)
    start = train(spec, first, source, tuned, init=arguments.checkpoint)
    minutes = arguments.minutes * FINAL_SHARE
    last = recipe_settings("scratch", minutes=minutes, schedule="decay", **shared)
    end = train(spec, last, source, final, branch=tuned)
    after = {name: scores(end.checkpoint, test) for name, test in tests.items()}
    note(f"after: {after}")
    result = {
        "checkpoint": arguments.checkpoint.name,
        "pictures": PICTURES,
        "test pictures": TEST_PICTURES,
        "minutes": arguments.minutes,
        "steps": start.steps + end.steps,
        "before": before,
        "after": after,
    }
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
