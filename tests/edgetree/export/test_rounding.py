"""Weights of 8-bit convolutions are rounded so that the outputs change least."""

from __future__ import annotations

from typing import Any

import numpy as np
import onnxruntime
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from edgetree.export.layers import _SCOPES
from edgetree.export.rounding import round_weights

SIDE = 24
BITS = 4  # few, so that the errors are large

CONVOLUTIONS = {
    "dense": ((6, 4, 3, 3), {"pads": [1, 1, 1, 1]}),
    "strided": ((6, 4, 3, 3), {"strides": [2, 2]}),
    "pointwise": ((6, 4, 1, 1), {}),
    "depthwise": ((4, 1, 5, 5), {"group": 4, "pads": [2, 2, 2, 2]}),
    "grouped": ((6, 2, 3, 3), {"group": 2}),
}


def network(*layers: tuple[NDArray[np.float32], dict[str, Any]], scope: str = "model.trunk") -> Any:
    """A graph of convolutions of 4 channels that all read the input."""
    nodes, weights, outputs = [], [], []
    for number, (weight, attributes) in enumerate(layers):
        nodes.append(
            helper.make_node(
                "Conv", ["image", f"w{number}"], [f"y{number}"], f"conv{number}", **attributes
            )
        )
        entry = nodes[-1].metadata_props.add()
        entry.key, entry.value = _SCOPES, str([scope])
        weights.append(numpy_helper.from_array(weight, f"w{number}"))
        outputs.append(helper.make_tensor_value_info(f"y{number}", TensorProto.FLOAT, None))
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 4, SIDE, SIDE])
    graph = helper.make_graph(nodes, "network", [image], outputs, weights)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)


def smooth_frames(count: int, seed: int = 0) -> NDArray[np.float32]:
    """Frames whose neighbouring pixels and channels are alike, as those of a network."""
    rng = np.random.default_rng(seed)
    coarse = rng.random((count, 1, SIDE // 6, SIDE // 6)) + 0.2 * rng.random((count, 4, 4, 4))
    return np.kron(coarse, np.ones((1, 1, 6, 6))).astype(np.float32)


def random_weight(shape: tuple[int, ...], seed: int = 3) -> NDArray[np.float32]:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def weights_of(model: Any) -> dict[str, NDArray[np.float32]]:
    return {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}


def run(model: Any, frames: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    made = [session.run(None, {"image": frame[None]}) for frame in frames]
    return [np.concatenate(outputs) for outputs in zip(*made, strict=True)]


@pytest.mark.parametrize("kind", CONVOLUTIONS)
def test_outputs_change_less_than_with_the_nearest_values(kind: str) -> None:
    shape, attributes = CONVOLUTIONS[kind]
    model = network((random_weight(shape), attributes))
    rounded, scales = round_weights(model, smooth_frames(16), BITS)
    weight, made, scale = weights_of(model)["w0"], weights_of(rounded)["w0"], scales["w0"]
    steps = scale[:, None, None, None]
    nearest = network((np.rint(weight / steps) * steps, attributes))
    unseen = smooth_frames(8, seed=1)
    (wanted,), (found,), (usual,) = (run(each, unseen) for each in (model, rounded, nearest))
    error, usual_error = ((each - wanted) ** 2 for each in (found, usual))
    assert error.mean() < 0.7 * usual_error.mean()
    assert not np.array_equal(made, np.rint(weight / steps) * steps)


@pytest.mark.parametrize("kind", CONVOLUTIONS)
def test_weights_are_whole_multiples_within_their_bits(kind: str) -> None:
    shape, attributes = CONVOLUTIONS[kind]
    model = network((random_weight(shape), attributes))
    rounded, scales = round_weights(model, smooth_frames(16), BITS)
    levels = weights_of(rounded)["w0"] / scales["w0"][:, None, None, None]
    assert np.allclose(levels, np.rint(levels), atol=1e-4)
    assert np.abs(levels).max() <= 2 ** (BITS - 1) + 1e-4
    assert np.array_equal(weights_of(model)["w0"], random_weight(shape)), "the model was changed"


def test_large_kernels_and_what_is_outside_of_the_network_stay_as_they_are() -> None:
    large, small = random_weight((2, 4, 17, 17)), random_weight((2, 4, 3, 3))
    rounded, scales = round_weights(network((large, {}), (small, {})), smooth_frames(4), BITS)
    assert np.array_equal(weights_of(rounded)["w0"], large)
    assert scales.keys() == {"w1"}
    arithmetic = network((small, {}), scope="decoding")
    assert round_weights(arithmetic, smooth_frames(4), BITS)[1] == {}


def test_inputs_that_are_all_zero_are_no_error() -> None:
    model = network((random_weight((6, 4, 3, 3)), {}))
    rounded, scales = round_weights(model, np.zeros((4, 4, SIDE, SIDE), np.float32), BITS)
    steps = scales["w0"][:, None, None, None]
    assert np.allclose(weights_of(rounded)["w0"], np.rint(weights_of(model)["w0"] / steps) * steps)


def test_a_weight_that_two_layers_share_is_rounded_once() -> None:
    model = network((random_weight((6, 4, 3, 3)), {}), (random_weight((6, 4, 3, 3)), {}))
    model.graph.node[1].input[1] = "w0"
    rounded, scales = round_weights(model, smooth_frames(16), BITS)
    levels = weights_of(rounded)["w0"] / scales["w0"][:, None, None, None]
    assert np.allclose(levels, np.rint(levels), atol=1e-4)
    assert np.allclose(
        scales["w0"], np.abs(weights_of(model)["w0"]).max((1, 2, 3)) / 2 ** (BITS - 1)
    )
