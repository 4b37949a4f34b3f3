"""Batch norms that add another epsilon to the variance than those a network was trained with."""

from __future__ import annotations

from torch import Tensor, nn


def compensate_epsilon(network: nn.Module, weights: dict[str, Tensor], epsilon: float) -> None:
    """Scale the weights of batch norms so that a network's norms give what their own ones gave.

    Args:
        network: Network whose norms have an epsilon of their own.
        weights: Weights for it, by name; those of its norms are replaced.
        epsilon: What the norms of the weights' own network add to the variance.
    """
    for name in [name for name in weights if name.endswith(".running_var")]:
        norm = name.removesuffix(".running_var")
        own = float(network.get_submodule(norm).eps)  # type: ignore[arg-type]
        factor = ((weights[name] + own) / (weights[name] + epsilon)).sqrt()
        weights[f"{norm}.weight"] = weights[f"{norm}.weight"] * factor
