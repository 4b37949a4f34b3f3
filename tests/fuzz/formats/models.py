"""Model files, checkpoints, weights and training states."""

from __future__ import annotations

import io
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save

from edgetree.catalogue import default_model
from edgetree.export.combining import combine_models
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.providers import CPU, SessionSettings
from edgetree.runtime.session import OrtSession
from formats.form import Format
from perceptree.models import load_checkpoint, make_spec
from perceptree.models.weights.reading import read_weights
from perceptree.training.state import read_state

_IDENTITY = {"settings": {"batch": 2}}


def _model() -> bytes:
    return onnx_bytes(
        [Node("MatMul", ("x", "weights"), ("y",)), Node("Reshape", ("y", "n"), ("z",))],
        inputs={"x": TensorType("float32", ("batch", 4))},
        outputs={"z": TensorType("float32", ("batch", 3))},
        constants={"weights": np.ones((4, 3), np.float32), "n": np.array([1, 3])},
        metadata={"name": "small"},
    )


def _checkpoint() -> bytes:
    spec = make_spec("edge-n", "depth", 64, 128, fpn_width=16, box_head_width=16)
    record = {"schema": "perceptree.checkpoint/1", "spec": spec.to_dict(), "training": {}}
    return save({"weight": torch.ones(3)}, metadata={"perceptree": json.dumps(record)})


def _torch_bytes(content: Any, *, in_zip: bool = True) -> bytes:
    buffer = io.BytesIO()
    torch.save(content, buffer, _use_new_zipfile_serialization=in_zip)
    return buffer.getvalue()


def _weights() -> tuple[bytes, ...]:
    tensors = {"stem.weight": torch.ones(2, 3), "stem.bias": torch.zeros(2)}
    arrays = {"stem.weight": np.ones((2, 3), np.float32), "stem.bias": np.zeros(2)}
    return (
        _torch_bytes({"model": tensors}),
        _torch_bytes(tensors, in_zip=False),
        pickle.dumps({"model": arrays}, protocol=2),
        pickle.dumps(arrays, protocol=4),
    )


def _state() -> bytes:
    weight = torch.nn.Parameter(torch.ones(2))
    return _torch_bytes(
        {
            "model": {"weight": torch.ones(2)},
            "average": {"weight": torch.ones(2)},
            "optimizer": torch.optim.AdamW([weight]).state_dict(),
            "precision": "fp32",
            "step": 10,
            "first_step": 0,
            "stale": 0,
            "evaluated_at": -1,
            "elapsed_s": 12.5,
            "waited_s": 0.5,
            "means": {"total": 1.5},
            "version": 1,
            "best": {"box_ap": 50.0},
            "identity": json.dumps(_IDENTITY),
        }
    )


def _open_model(path: Path) -> None:
    OrtSession(path, SessionSettings(CPU, threads=1))


def _combine(path: Path) -> object:
    out = path.with_name("combined.onnx")
    return combine_models(path, "edge-s-rgb", "edge-s-depth", out, lambda _: None)


def _manifest() -> bytes:
    return read_model_file(default_model("depth")).metadata["edgetree.manifest"].encode()


FORMATS = {
    "model.onnx": Format((_model(),), _open_model),
    "combined": Format((_model(),), _combine, refused="no manifest"),
    "manifest": Format((_manifest(),), lambda path: Manifest.from_json(path.read_text("utf-8"))),
    "checkpoint": Format((_checkpoint(),), load_checkpoint, refused="is missing"),
    "weights": Format(_weights(), read_weights),
    "state": Format((_state(),), lambda path: read_state(path, _IDENTITY)),
}
