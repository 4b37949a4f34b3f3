"""The weighted mean of several networks' weights (Wortsman et al. 2022, "Model soups")."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec, TreeRCNN, load_checkpoint
from perceptree.training.credits import joined_credits

_REACH = "reach_m"


def average_checkpoints(
    paths: Sequence[Path], shares: Sequence[float]
) -> tuple[TreeRCNN, dict[str, Any]]:
    """Average the weights and the statistics of batch norms of checkpoints.

    Args:
        paths: Checkpoints of one network, whose input sizes may differ.
        shares: Weight of each, over 0; they are divided by their sum.

    Returns:
        The network with the input size of the first file, and the training record of that file with
        all records under `average_of`; without `reach_m` if they state different ones, or one of
        them none.

    Raises:
        CheckpointError: If a file cannot be read, or holds another network than the first.
    """
    loaded = [load_checkpoint(path) for path in paths]
    model = loaded[0][0]
    for path, (other, _) in zip(paths, loaded, strict=True):
        if _network(other.spec) != _network(model.spec):
            raise CheckpointError(f"{path}: expected a network like that of {paths[0]}")
    parts = torch.tensor(shares, dtype=torch.float64)
    parts /= parts.sum()
    states = [network.state_dict() for network, _ in loaded]
    model.load_state_dict(
        {
            name: torch.tensordot(parts, torch.stack([state[name] for state in states]).double(), 1)
            for name in states[0]
        }
    )
    records = [
        {"file": path.name, "share": float(part), **record["training"]}
        for path, part, (_, record) in zip(paths, parts, loaded, strict=True)
    ]
    owed = joined_credits(records)
    first = dict(loaded[0][1]["training"])
    if any(record.get(_REACH) != first.get(_REACH) for record in records):
        first.pop(_REACH, None)  # an exported file would lower the scores of trees that one knows
    return model, {**first, **owed, "average_of": records}


def _network(spec: ModelSpec) -> ModelSpec:
    """The spec without its name and what grows with the input."""
    return dataclasses.replace(
        spec, name="", height=32, width=32, anchor_sizes_px=tuple((1.0,) for _ in spec.levels)
    )
