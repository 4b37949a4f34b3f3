"""Training with rounded weights: what is learned, what is saved, what is restored."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import nn

from basetree.errors import SettingsError
from perceptree.models import ModelSpec, load_checkpoint
from perceptree.training import TrainSettings, train
from perceptree.training.rounding import rounded_weights

BITS = 3
LEVELS = 2 ** (BITS - 1)


def levels_of(weight: torch.Tensor) -> torch.Tensor:
    """Weights as multiples of the scale of their output."""
    rows = weight.detach().flatten(1)
    return rows * LEVELS / rows.abs().amax(1, keepdim=True).clamp(min=1e-12)


def test_a_checkpoint_holds_rounded_weights_and_the_state_exact_ones(
    posts: Path,
    tmp_path: Path,
    narrow: Callable[..., ModelSpec],
    plan: Callable[..., TrainSettings],
) -> None:
    report = train(narrow(), plan(weight_bits=BITS), posts, tmp_path / "run")
    model, record = load_checkpoint(report.checkpoint)
    layers = [m for m in model.modules() if isinstance(m, nn.Conv2d | nn.Linear)]
    assert len(layers) > 40
    for layer in layers:
        levels = levels_of(layer.weight)
        assert torch.allclose(levels, levels.round(), atol=1e-3)
    assert record["training"]["settings"]["weight_bits"] == BITS
    state = torch.load(tmp_path / "run/state.pt", weights_only=True)
    hidden = levels_of(state["model"]["box_head.hidden.0.weight"])
    assert not torch.allclose(hidden, hidden.round(), atol=1e-3)


def test_weights_are_exact_again_after_the_block_even_after_an_error() -> None:
    torch.manual_seed(0)
    model = nn.Sequential(nn.Conv2d(3, 4, 3), nn.Linear(5, 6), nn.ConvTranspose2d(4, 4, 2))
    before = [p.detach().clone() for p in model.parameters()]
    inside: list[torch.Tensor] = []

    def fail() -> None:
        with rounded_weights(model, BITS):
            inside.extend(p.detach().clone() for p in model.parameters())
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert all(map(torch.equal, model.parameters(), before))
    kept = [torch.equal(a, b) for a, b in zip(inside, before, strict=True)]
    assert kept == [False, True, False, True, True, True]  # weight and bias of each layer


def test_8_bits_fit_into_a_signed_byte() -> None:
    torch.manual_seed(0)
    layer = nn.Linear(50, 4)
    with rounded_weights(layer, 8):
        rows = layer.weight.detach()
        levels = rows * 127 / rows.abs().amax(1, keepdim=True)
    assert torch.allclose(levels, levels.round(), atol=1e-3)


@pytest.mark.parametrize("bits", [1, 9])
def test_impossible_bits_are_refused(bits: int) -> None:
    with pytest.raises(SettingsError, match=f"weight_bits is {bits}: expected 2 to 8"):
        TrainSettings(steps=1, weight_bits=bits)
