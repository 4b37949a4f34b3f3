"""Training states with broken or impossible values are refused with one line."""

import random
from pathlib import Path
from typing import Any

import pytest
import torch

from perceptree.errors import CheckpointError
from perceptree.training.state import read_state, write_state

IDENTITY = {"settings": {"batch": 2}}


def state(**changes: Any) -> dict[str, Any]:
    values: dict[str, Any] = {
        "model": {"weight": torch.ones(4)},
        "average": None,
        "optimizer": {"state": {}, "param_groups": []},
        "precision": "fp32",
        "step": 10,
        "first_step": 0,
        "elapsed_s": 12.5,
        "waited_s": 0.5,
        "means": {"total": 1.5},
        "best": {"box_ap": 50.0},
        "stale": 0,
        "evaluated_at": -1,
    }
    return values | changes


def test_a_whole_state_is_read(tmp_path: Path) -> None:
    write_state(tmp_path / "state.pt", state(), IDENTITY)
    assert read_state(tmp_path / "state.pt", IDENTITY)["step"] == 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step": float("inf")}, "step is inf, expected a number of steps"),
        ({"step": True}, "step is True"),
        ({"step": 10**400}, "step is 1000"),
        ({"step": -5}, "step is -5"),
        ({"first_step": 11}, "first_step is 11, after step 10"),
        ({"elapsed_s": float("nan")}, "elapsed_s is nan, expected seconds"),
        ({"waited_s": "long"}, "waited_s is 'long'"),
        ({"means": {"total": float("inf")}}, "means are no finite numbers"),
        ({"best": 3}, "best has no box_ap"),
        ({"model": {"weight": torch.tensor([float("nan")])}}, "weight holds NaN or infinity"),
        ({"model": [1]}, "model does not hold tensors by name"),
        ({"average": {"weight": 1}}, "average does not hold tensors by name"),
        ({"optimizer": None}, "optimizer or precision is of another type"),
    ],
)
def test_impossible_values_are_named(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "state.pt"
    write_state(path, state(**change), IDENTITY)
    with pytest.raises(CheckpointError) as caught:
        read_state(path, IDENTITY)
    assert str(caught.value).startswith(f"{path}: not a readable training state (")
    assert message in str(caught.value)


@pytest.mark.parametrize("identity", ["[1]", "{", "[" * 100_000, '{"settings": 3}', 7])
def test_identities_that_are_none_are_refused(identity: Any, tmp_path: Path) -> None:
    path = tmp_path / "state.pt"
    torch.save({**state(), "version": 1, "identity": identity}, path)
    with pytest.raises(CheckpointError, match="not a readable training state"):
        read_state(path, IDENTITY)


def test_no_damage_raises_another_error(tmp_path: Path) -> None:
    path = tmp_path / "state.pt"
    write_state(path, state(), IDENTITY)
    whole = path.read_bytes()
    rng = random.Random(0)
    refused = kept = 0
    for _ in range(150):
        content = bytearray(whole)
        for _ in range(rng.randint(1, 8)):
            content[rng.randrange(len(content))] = rng.randrange(256)
        path.write_bytes(bytes(content[: rng.choice((len(content), rng.randrange(len(content))))]))
        try:
            read_state(path, IDENTITY)
        except CheckpointError as error:
            refused += "\n" not in str(error)
            continue
        kept += 1
    assert refused + kept == 150
    assert refused > 75
