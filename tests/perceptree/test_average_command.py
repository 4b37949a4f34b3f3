"""``perceptree average``: the mean of several checkpoints."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from perceptree.models import ModelSpec, TreeRCNN, load_checkpoint, make_spec, save_checkpoint

Call = Callable[..., tuple[int, str, str]]


def write(path: Path, value: float, spec: ModelSpec) -> Path:
    model = TreeRCNN(spec)
    with torch.no_grad():
        for tensor in model.state_dict().values():
            tensor.fill_(value)
    save_checkpoint(path, model, {"steps": int(value)})
    return path


@pytest.fixture
def spec() -> ModelSpec:
    return make_spec("edge-n", "rgb", 64, 96, fpn_width=8, box_head_width=8)


def test_the_mean_has_the_given_shares(call: Call, tmp_path: Path, spec: ModelSpec) -> None:
    files = [write(tmp_path / f"{value}.safetensors", value, spec) for value in (1.0, 4.0)]
    out = tmp_path / "mean.safetensors"
    for shares, expected in (([], 2.5), (["--weights", "1,3"], 3.25)):
        code, told, _ = call("average", *files, "--out", out, *shares)
        assert (code, told) == (0, f"checkpoint: {out}\n")
        model, record = load_checkpoint(out)
        values = [v for v in model.state_dict().values() if v.is_floating_point()]
        assert all(torch.allclose(value, torch.tensor(expected)) for value in values)
        parts = record["training"]["average_of"]
        assert [part["steps"] for part in parts] == [1, 4]
    assert [part["share"] for part in parts] == [0.25, 0.75]


@pytest.mark.parametrize(("second_m", "expected_m"), [(10.0, 10.0), (20.0, None), (None, None)])
def test_the_mean_has_the_reach_that_all_have(
    call: Call,
    tmp_path: Path,
    spec: ModelSpec,
    second_m: float | None,
    expected_m: float | None,
) -> None:
    files = [tmp_path / "near.safetensors", tmp_path / "far.safetensors"]
    for file, reach_m in zip(files, (10.0, second_m), strict=True):
        save_checkpoint(file, TreeRCNN(spec), {} if reach_m is None else {"reach_m": reach_m})
    out = tmp_path / "mean.safetensors"
    assert call("average", *files, "--out", out)[0] == 0
    assert load_checkpoint(out)[1]["training"].get("reach_m") == expected_m


def test_input_sizes_may_differ_and_the_first_counts(
    call: Call, tmp_path: Path, spec: ModelSpec
) -> None:
    larger = make_spec("edge-n", "rgb", 96, 128, fpn_width=8, box_head_width=8)
    files = [
        write(tmp_path / "large.safetensors", 1.0, larger),
        write(tmp_path / "small.safetensors", 2.0, spec),
    ]
    out = tmp_path / "mean.safetensors"
    assert call("average", *files, "--out", out)[0] == 0
    assert load_checkpoint(out)[0].spec == larger


def test_what_cannot_be_averaged_is_refused_in_one_line(
    call: Call, tmp_path: Path, spec: ModelSpec
) -> None:
    first = write(tmp_path / "first.safetensors", 1.0, spec)
    second = write(tmp_path / "second.safetensors", 1.0, make_spec("edge-n", "rgb", 64, 96))
    out = tmp_path / "mean.safetensors"
    for arguments, expected in (
        ([first, second], f"{second}: expected a network like that of {first}"),
        ([first], "1 checkpoint is given: expected two or more to average"),
        ([first, first, "--weights", "1,x"], "--weights is '1,x': expected 2 numbers over 0"),
        ([first, first, "--weights", "1,0"], "--weights is '1,0': expected 2 numbers over 0"),
    ):
        code, _, told = call("average", *arguments, "--out", out)
        assert code == 2
        assert expected in told
        assert told.count("\n") == 1
    assert not out.exists()
