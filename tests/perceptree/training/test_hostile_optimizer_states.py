"""States of optimizers that do not fit the training are refused before its first step."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from narrow_networks import narrow_spec, short_plan

from perceptree.errors import CheckpointError
from perceptree.training import train
from perceptree.training.optimizer_state import check_optimizer_state

Change = Callable[[dict[str, Any]], object]


def stepped(kind: str) -> torch.optim.Optimizer:
    """An optimizer of two parameters after a step."""
    parameters = [torch.nn.Parameter(torch.ones(2, 3)), torch.nn.Parameter(torch.ones(4))]
    optimizer: torch.optim.Optimizer = (
        torch.optim.SGD(parameters, lr=0.1, momentum=0.9)
        if kind == "SGD"
        else torch.optim.AdamW(parameters, lr=0.1)
    )
    sum(parameter.sum() for parameter in parameters).backward()  # type: ignore[union-attr]
    optimizer.step()
    return optimizer


CHANGES: dict[str, Change] = {
    "empty": lambda o: o.clear(),
    "text": lambda o: o.__setitem__("state", "x"),
    "no_groups": lambda o: o.__setitem__("param_groups", []),
    "group_text": lambda o: o.__setitem__("param_groups", ["x"]),
    "other_parameters": lambda o: o["param_groups"][0].__setitem__("params", [0, 5]),
    "rate": lambda o: o["param_groups"][0].__setitem__("lr", "fast"),
    "decay": lambda o: o["param_groups"][0].__setitem__("weight_decay", float("nan")),
    "betas": lambda o: o["param_groups"][0].__setitem__("betas", (0.9, 2.0)),
    "switch": lambda o: o["param_groups"][0].__setitem__("maximize", True),
    "unknown": lambda o: o["state"].__setitem__(7, {}),
    "key": lambda o: o["state"].__setitem__("0", o["state"].pop(0)),
    "entry": lambda o: o["state"].__setitem__(0, [1]),
    "step": lambda o: o["state"][0].__setitem__("step", "x"),
    "step_before": lambda o: o["state"][0].__setitem__("step", torch.tensor(-1.0)),
    "steps": lambda o: o["state"][0].__setitem__("step", torch.zeros(3)),
    "no_step": lambda o: o["state"][0].pop("step"),
    "shape": lambda o: o["state"][0].__setitem__("exp_avg", torch.zeros(1)),
    "turned": lambda o: o["state"][0].__setitem__("exp_avg", torch.zeros(3, 2)),
    "missing": lambda o: o["state"][1].pop("exp_avg_sq"),
    "number": lambda o: o["state"][1].__setitem__("exp_avg", 3.0),
    "nan": lambda o: o["state"][1]["exp_avg"].fill_(float("nan")),
    "below": lambda o: o["state"][1]["exp_avg_sq"].fill_(-1),
    "sparse": lambda o: o["state"][1].__setitem__("exp_avg", torch.zeros(4).to_sparse()),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_state_that_does_not_fit_is_named(change: str) -> None:
    optimizer = stepped("AdamW")
    state = optimizer.state_dict()
    check_optimizer_state(optimizer, state)
    CHANGES[change](state)
    with pytest.raises(ValueError, match="the optimizer"):
        check_optimizer_state(stepped("AdamW"), state)


def test_momentum_has_the_shape_of_its_parameter() -> None:
    optimizer = stepped("SGD")
    state = optimizer.state_dict()
    check_optimizer_state(optimizer, state)
    state["state"][0]["momentum_buffer"] = None  # a parameter that has not moved
    check_optimizer_state(optimizer, state)
    state["state"][0]["momentum_buffer"] = torch.zeros(5)
    with pytest.raises(ValueError, match=r"momentum_buffer of parameter 0 has shape \(5,\)"):
        check_optimizer_state(optimizer, state)


@pytest.mark.parametrize(
    "change",
    [
        lambda state: state["optimizer"]["state"][0].__setitem__("exp_avg", torch.zeros(1)),
        lambda state: state["optimizer"].clear(),
        lambda state: state["average"].clear(),
        lambda state: state["average"].__setitem__("n_averaged", torch.zeros(3)),
        lambda state: state["model"].__setitem__(next(iter(state["model"])), torch.zeros(2, 2)),
        lambda state: state.__setitem__("precision", "fp7"),
        lambda state: state.__setitem__("best", {"box_ap": 1.0}),
        lambda state: state.__setitem__("best", {"box_ap": 1.0, "frames": "many"}),
        lambda state: state.__setitem__("average", {"module": torch.zeros(1)}),
    ],
)
def test_a_training_refuses_its_broken_state_with_one_line(
    posts: Path, tmp_path: Path, change: Change
) -> None:
    out, spec = tmp_path / "run", narrow_spec("depth", 64, 128)
    train(spec, short_plan(steps=1), posts, out)
    path = out / "state.pt"
    state = torch.load(path, weights_only=True)
    assert state["optimizer"]["state"], "the first step has been taken"
    change(state)
    torch.save(state, path)
    with pytest.raises(CheckpointError) as caught:
        train(spec, short_plan(steps=2), posts, out)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
