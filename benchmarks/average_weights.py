"""Average the weights of several runs that began with the same weights.

python benchmarks/average_weights.py RUN/best.safetensors RUN/best.safetensors ... --out FILE

The average of networks that were fine-tuned on different data keeps much of what each of them
learned (Wortsman et al. 2022, Model soups). The running statistics of batch norms are averaged too.
The record of FILE is that of the last run, with those of the others under ``average_of``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from perceptree.errors import CheckpointError
from perceptree.models import load_checkpoint, save_checkpoint


def main() -> None:
    """Read the checkpoints and write their average, with where it comes from."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("checkpoints", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    loaded = [load_checkpoint(path) for path in arguments.checkpoints]
    model = loaded[0][0]
    for path, (other, _) in zip(arguments.checkpoints, loaded, strict=True):
        if other.spec != model.spec:
            raise CheckpointError(f"{path}: expected a network like {arguments.checkpoints[0]}")
    states = [network.state_dict() for network, _ in loaded]
    average = {
        name: torch.stack([state[name].double() for state in states]).mean(0).to(value.dtype)
        for name, value in states[0].items()
    }
    model.load_state_dict(average)
    sources = [record["training"] for _, record in loaded]
    save_checkpoint(arguments.out, model, sources[-1] | {"average_of": sources[:-1]})


if __name__ == "__main__":
    main()
