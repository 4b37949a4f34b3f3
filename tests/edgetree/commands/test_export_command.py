"""`edgetree export` and `edgetree verify`: what is told before PyTorch is loaded."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]

WRONG = {
    "checkpoint": (
        "none.safetensors",
        "frames",
        "none.safetensors: no such file, expected a .safetensors checkpoint",
    ),
    "exported": ("model.onnx", "frames", "model.onnx: is an exported model, expected its"),
    "frames": ("best.safetensors", "none", "none is no folder: expected one with frames"),
    "a file": ("best.safetensors", "model.onnx", "model.onnx is no folder: expected one"),
}


def test_a_checkpoint_is_told_where_a_file_is_expected(run_cli: Cli, tmp_path: Path) -> None:
    checkpoint = tmp_path / "best.safetensors"
    checkpoint.write_bytes(b"\x01" * 100)
    for words in (["eval", checkpoint, tmp_path], ["run", tmp_path, "--model", checkpoint]):
        done = run_cli(*words)
        assert (done.code, done.err.count("\n")) == (2, 1)
        assert "best.safetensors is a checkpoint: expected the .onnx file that `edge" in done.err


@pytest.mark.parametrize("command", ["export", "verify"])
@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_path_is_told_before_torch_is_loaded(
    run_cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, wrong: str
) -> None:
    checkpoint, data, message = WRONG[wrong]
    (tmp_path / "frames").mkdir()
    for name in ("model.onnx", "best.safetensors"):
        (tmp_path / name).touch()
    monkeypatch.setitem(sys.modules, "edgetree.export.exporter", None)
    words = ["export"] if command == "export" else ["verify", tmp_path / "model.onnx"]
    more = ["--out", tmp_path / "out.onnx"] if command == "export" else []
    done = run_cli(*words, tmp_path / checkpoint, "--data", tmp_path / data, *more)
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert message in done.err
