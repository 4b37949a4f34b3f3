"""Begin a model's card with the simulated scenes that it was made with.

python -m release.scenes models/edge-s-depth.json --after models/edge-n-depth.json \\
    --training data/paper-907 data/field-907 --scale data/cal-paper --ranges data/paper-907

`release/cards.py` adds the figures. A test holds the scenes against those of the frozen test sets.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from basetree.files.writing import write_text
from benchmarks.tools.program import command_line
from edgetree.model_file.card import CARD_SCHEMA
from perceptree.data import SPLITS

USES = {"training": "training", "scale": "scale of the scores", "ranges": "ranges of INT8"}


def scenes_of(folder: Path, use: str) -> dict[str, Any]:
    """What a card says of a dataset of `perceptree synth`."""
    settings = json.loads((folder / "settings.json").read_text("utf-8"))
    labels = [json.loads((folder / f"{split}_RGB.json").read_text("utf-8")) for split in SPLITS]
    return {
        "use": use,
        "data": folder.name,
        "seed": settings["seed"],
        "scenes": len(list((folder / "scenes").glob("*.json"))),
        "frames": sum(len(each["images"]) for each in labels),
    }


def main() -> None:
    """Write the card."""
    parser = command_line(__doc__)
    parser.add_argument("card", type=Path, help="file to write, MODEL.json")
    parser.add_argument(
        "--after", type=Path, nargs="+", default=[], help="cards of the models that it began with"
    )
    for option, use in USES.items():
        parser.add_argument(f"--{option}", type=Path, nargs="+", default=[], help=f"data for {use}")
    parser.add_argument(
        "--holds", type=Path, nargs="+", default=[], help="cards of the models in a combined file"
    )
    options = parser.parse_args()
    known: list[dict[str, Any]] = []
    for path in options.holds:
        held = json.loads(path.read_text("utf-8"))["training_scenes"]
        known += [each for each in held if each not in known]
    for path in options.after:
        before = json.loads(path.read_text("utf-8"))["training_scenes"]
        of_training = (each for each in before if each["use"].startswith(USES["training"]))
        known += [each for each in of_training if each not in known]
    for option, use in USES.items():
        known += [scenes_of(folder, use) for folder in getattr(options, option)]
    card = {"schema": CARD_SCHEMA, "model": options.card.stem, "training_scenes": known}
    write_text(options.card, json.dumps(card, indent=1) + "\n")


if __name__ == "__main__":
    main()
