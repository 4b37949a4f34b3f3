"""Make the proposal network's convolution of a checkpoint separable, to train it further.

python -m release.separable models/edge-s.safetensors --out runs/separable.safetensors
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.tools.program import command_line
from perceptree.models import load_checkpoint, save_checkpoint
from perceptree.models.separable import with_separable_proposals


def main() -> None:
    """Write the checkpoint."""
    parser = command_line(__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    model, record = load_checkpoint(options.checkpoint)
    save_checkpoint(options.out, with_separable_proposals(model), record["training"])


if __name__ == "__main__":
    main()
