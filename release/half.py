"""Write a checkpoint in half precision, to go on from.

python -m release.half models/edge-n-depth.safetensors --out checkpoints/edge-n-depth.safetensors

Of the weights' record, the scenes and picture statistics of the runs that it is the average of are
left out.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.tools.program import command_line
from perceptree.models import load_checkpoint, save_checkpoint


def main() -> None:
    """Write the checkpoint."""
    parser = command_line(__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    model, record = load_checkpoint(options.checkpoint)
    training = record["training"]
    for run in training.get("average_of", []):
        run.pop("scenes", None)
        run.pop("pictures", None)
    save_checkpoint(options.out, model.half(), training)


if __name__ == "__main__":
    main()
