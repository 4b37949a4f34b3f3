"""Contents of int8 and float16 graphs, and their outputs."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray
from onnx import TensorProto

from edgetree.export.build import output_names, trace
from edgetree.export.float16 import to_float16
from edgetree.export.frames import find_frames, read_frames
from edgetree.export.layers import frame_reader
from edgetree.export.quantise import quantise, weight_bits
from edgetree.export.rounding import round_weights
from edgetree.export.settings import OPSET
from edgetree.model_file.manifest import SCORE_INPUT
from perceptree.models import TreeRCNN, load_checkpoint

BYTE_MOVERS = {"Concat", "Expand", "Gather", "Pad", "Reshape", "Slice", "Transpose", "Unsqueeze"}


class Graph:
    """Look up the nodes and constants of a graph by their tensors."""

    def __init__(self, proto: Any) -> None:
        self.nodes = list(proto.graph.node)
        self.makers = {name: node for node in self.nodes for name in node.output}
        self.constants = {value.name: value for value in proto.graph.initializer}

    def of(self, *kinds: str) -> list[Any]:
        return [node for node in self.nodes if node.op_type in kinds]

    def takers(self, name: str) -> list[Any]:
        return [node for node in self.nodes if name in node.input]

    def weight_of(self, node: Any) -> Any:
        """The weight of a node, before dequantisation if there is any."""
        name = node.input[1]
        source = self.makers.get(name)
        return self.constants[source.input[0] if source is not None else name]

    def is_8_bit(self, node: Any) -> bool:
        makers = [self.makers.get(name) for name in node.input[:2]]
        return all(m is not None and m.op_type == "DequantizeLinear" for m in makers)

    def upstream(self, node: Any) -> Iterator[Any]:
        """All nodes upstream of a node's first input, through first inputs and concatenations."""
        waiting = [node.input[0]]
        while waiting:
            source = self.makers.get(waiting.pop())
            if source is not None:
                yield source
                joined = source.op_type == "Concat"
                waiting += source.input if joined else source.input[:1]


@pytest.fixture(scope="module")
def model(rgb_checkpoint: Path) -> TreeRCNN:
    return load_checkpoint(rgb_checkpoint)[0]


@pytest.fixture(scope="module")
def frames(model: TreeRCNN, frame_folder: Path) -> NDArray[np.uint8]:
    return read_frames(find_frames(frame_folder, "rgb", 4), model.spec)


@pytest.fixture(scope="module")
def plain(model: TreeRCNN, traced: Callable[..., Any]) -> bytes:
    proto: bytes = traced(model, 1, OPSET, quantised=True).SerializeToString()
    return proto


@pytest.fixture(scope="module")
def int8(plain: bytes, frames: NDArray[np.uint8]) -> Graph:
    return Graph(quantise(onnx.ModelProto.FromString(plain), frames))


def test_the_rounded_weights_are_stored_as_they_are(
    plain: bytes, int8: Graph, frames: NDArray[np.uint8]
) -> None:
    traced = onnx.ModelProto.FromString(plain)
    rounded, scales = round_weights(traced, frames, weight_bits(symmetric=False))
    wanted = {each.name: onnx.numpy_helper.to_array(each) for each in rounded.graph.initializer}
    compared = 0
    for node in int8.nodes:
        name = node.input[0].removesuffix("_quantized")
        if node.op_type == "DequantizeLinear" and name in scales:
            values, scale = (
                onnx.numpy_helper.to_array(int8.constants[each]) for each in node.input[:2]
            )
            found = values * scale[:, None, None, None]
            assert np.allclose(found, wanted[name], atol=scale.max() / 100), name
            compared += 1
    assert compared >= len(scales) > 40


def test_quantising_does_not_change_the_traced_model(
    plain: bytes, frames: NDArray[np.uint8]
) -> None:
    traced = onnx.ModelProto.FromString(plain)
    quantise(traced, frames[:1])
    assert traced.SerializeToString() == plain


def test_activations_are_unsigned_and_weights_signed_per_channel(int8: Graph) -> None:
    count = {"uint8": 0, "int8": 0, "int32": 0}
    for node in int8.nodes:
        if node.op_type == "QuantizeLinear":
            assert int8.constants[node.input[2]].data_type == TensorProto.UINT8
            count["uint8"] += 1
        elif node.op_type == "DequantizeLinear" and node.input[0] in int8.constants:
            kind = TensorProto.DataType.Name(int8.constants[node.input[0]].data_type).lower()
            count[kind] += 1
            assert len(int8.constants[node.input[1]].dims) == 1
    assert min(count.values()) > 30


def test_weights_use_as_many_bits_as_stated(
    int8: Graph, plain: bytes, frames: NDArray[np.uint8]
) -> None:
    signed = Graph(quantise(onnx.ModelProto.FromString(plain), frames, symmetric=True))
    for graph, bits in (
        (int8, weight_bits(symmetric=False)),
        (signed, weight_bits(symmetric=True)),
    ):
        largest = max(
            int(np.abs(onnx.numpy_helper.to_array(graph.weight_of(node)).astype(int)).max())
            for node in graph.of("Conv")
        )
        assert 2 ** (bits - 2) < largest <= 2 ** (bits - 1)


def test_every_convolution_and_the_heads_take_8_bits(int8: Graph, model: TreeRCNN) -> None:
    convolutions = int8.of("Conv")
    assert len(convolutions) > 40
    assert [node.name for node in convolutions if not int8.is_8_bit(node)] == []
    # The mask and keypoint convolutions and the box head are downstream of RoIAlign.
    fed = [n for n in convolutions if any(s.op_type == "RoiAlign" for s in int8.upstream(n))]
    assert len(fed) >= len(model.spec.mask_head_widths) + len(model.spec.keypoint_head_widths)
    products = {tuple(int8.weight_of(node).dims): int8.is_8_bit(node) for node in int8.of("Gemm")}
    width = model.spec.box_head_width
    hidden = {shape for shape, quantised in products.items() if quantised}
    assert {max(shape) for shape in hidden} == {width, model.spec.fpn_width * 49}
    assert {min(shape) for shape in products if not products[shape]} <= {2, 4}


def test_maps_of_the_pyramid_are_upsampled_in_8_bits(int8: Graph, model: TreeRCNN) -> None:
    assert not [node for node in int8.of("Resize") if int8.is_8_bit(node)]
    copies = [n for n in int8.of("Gather") if n.name.startswith("node_index_select")]
    assert len(copies) == 2 * (len(model.spec.levels) - 1)
    for node in copies:
        source = int8.makers[node.input[0]]
        (quantise,) = int8.takers(node.output[0])
        # With the same scale and zero point before and after, the runtime copies bytes.
        assert (source.op_type, quantise.op_type) == ("DequantizeLinear", "QuantizeLinear")
        before, after = (
            [onnx.numpy_helper.to_array(int8.constants[name]) for name in each.input[1:]]
            for each in (source, quantise)
        )
        assert before == after


def test_last_layers_take_8_bits_and_give_floats(int8: Graph, model: TreeRCNN) -> None:
    products = [node for node in int8.of("MatMul") if int8.is_8_bit(node)]
    per_cell = model.spec.anchors_per_cell
    shapes = [tuple(int8.weight_of(node).dims) for node in products]
    assert [shape[1] for shape in shapes].count(per_cell) == len(model.spec.levels)
    assert [shape[1] for shape in shapes].count(4 * per_cell) == len(model.spec.levels)
    assert (model.spec.keypoint_head_widths[-1], 16 * 5) in shapes
    assert (4 * model.spec.mask_head_widths[-1], 4) in shapes
    for node in (*products, *(n for n in int8.of("Gemm") if not int8.is_8_bit(n))):
        takers = int8.takers(node.output[0])
        assert takers
        assert "QuantizeLinear" not in {taker.op_type for taker in takers}


def test_image_bytes_reach_the_first_convolution_unchanged(int8: Graph) -> None:
    waiting, seen = ["image"], []
    while waiting:
        for node in int8.takers(waiting.pop()):
            seen.append(node.op_type)
            if node.op_type == "DequantizeLinear":
                scale, zero = (
                    onnx.numpy_helper.to_array(int8.constants[n]) for n in node.input[1:]
                )
                assert (float(scale), zero.dtype, int(zero)) == (1.0, np.uint8, 114)
                (first,) = int8.takers(node.output[0])
                assert first.op_type == "Conv"
            else:
                assert node.op_type in BYTE_MOVERS
                waiting += node.output
    assert "DequantizeLinear" in seen


def test_for_tensorrt_activations_are_signed_about_zero(
    plain: bytes, frames: NDArray[np.uint8]
) -> None:
    graph = Graph(quantise(onnx.ModelProto.FromString(plain), frames, symmetric=True))
    quantising = graph.of("QuantizeLinear")
    assert len(quantising) > 30
    for node in quantising:
        zero = graph.constants[node.input[2]]
        assert zero.data_type == TensorProto.INT8
        assert not onnx.numpy_helper.to_array(zero).any()


@pytest.mark.parametrize(("count", "batch", "calls"), [(5, 2, 2), (4, 4, 1), (3, 4, 1), (1, 4, 1)])
def test_calibration_fills_batches_of_the_model(count: int, batch: int, calls: int) -> None:
    shape = (batch, 8, 8)
    value = onnx.helper.make_tensor_value_info("image", TensorProto.UINT8, shape)
    proto = onnx.helper.make_model(onnx.helper.make_graph([], "g", [value], [value]))
    frames = np.arange(count, dtype=np.uint8)[:, None, None].repeat(8, axis=1).repeat(8, axis=2)
    reader = frame_reader(proto, frames)
    batches = list(iter(reader.get_next, None))
    assert len(batches) == calls
    assert {images["image"].shape for images in batches} == {shape}
    numbers = [int(image[0, 0]) for images in batches for image in images["image"]]
    assert numbers[:count] == list(range(count))[: len(numbers)]


@pytest.mark.slow
def test_a_batch_of_four_is_calibrated_on_three_frames(
    model: TreeRCNN, frames: NDArray[np.uint8]
) -> None:
    proto = quantise(trace(model, batch=4, quantised=True), frames[:3])
    session = onnxruntime.InferenceSession(
        proto.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    boxes, scores, *_ = session.run(None, {"image": frames[[0, 1, 2, 0]]})
    assert boxes.shape == (4, model.spec.detections, 4)
    assert scores[:, 0].min() > 0.5
    np.testing.assert_allclose(boxes[0], boxes[3])


LOUD = {"convs.0.weight": 3e6, "convs.1.weight": 1 / 3e6}  # the biases are 0


@pytest.fixture(scope="module")
def half(model: TreeRCNN, frames: NDArray[np.uint8], traced: Callable[..., Any]) -> Any:
    """A float16 graph. One layer of its mask head is so loud that float16 overflows."""
    proto = traced(model, 1, OPSET)
    constants = {value.name: value for value in proto.graph.initializer}
    for name, factor in LOUD.items():
        constant = constants[f"model.mask_head.tower.{name}"]
        values = onnx.numpy_helper.to_array(constant) * np.float32(factor)
        constant.CopyFrom(onnx.numpy_helper.from_array(values, constant.name))
    return to_float16(proto, frames)


def test_float16_keeps_the_types_of_inputs_and_outputs(half: Any, model: TreeRCNN) -> None:
    (image,) = half.graph.input
    assert image.type.tensor_type.elem_type == TensorProto.UINT8
    constants = {value.name: value.data_type for value in half.graph.initializer}
    assert constants[SCORE_INPUT] == TensorProto.FLOAT
    kinds = {value.name: value.type.tensor_type.elem_type for value in half.graph.output}
    assert kinds.pop("num_detections") == TensorProto.INT64
    assert set(kinds.values()) == {TensorProto.FLOAT}
    assert len(kinds) == 5


def test_float16_graph_is_sorted_and_rounds_no_coordinates(half: Any) -> None:
    onnx.checker.check_model(half)
    graph = Graph(half)
    names = [node.name for node in graph.nodes]
    assert len(set(names)) == len(names)
    target = {node.output[0]: node.attribute[0].i for node in graph.of("Cast")}
    for node in graph.of("Cast"):
        back = target[node.output[0]] == TensorProto.FLOAT
        assert not (back and target.get(node.input[0]) == TensorProto.FLOAT16), node.name


def test_float16_is_used_in_the_network_but_not_for_coordinates(half: Any) -> None:
    graph = Graph(half)
    kinds = [graph.weight_of(node).data_type for node in graph.of("Conv")]
    assert kinds.count(TensorProto.FLOAT16) > 40
    sizes = {TensorProto.FLOAT16: 0, TensorProto.FLOAT: 0}
    for value in graph.constants.values():
        if value.data_type in sizes:
            sizes[value.data_type] += int(np.prod(value.dims))
    assert sizes[TensorProto.FLOAT16] > 10 * sizes[TensorProto.FLOAT]
    inferred = onnx.shape_inference.infer_shapes(half)
    kind = {v.name: v.type.tensor_type.elem_type for v in inferred.graph.value_info}
    for node in graph.of("NonMaxSuppression", "TopK", "Exp", "RoiAlign"):
        assert kind.get(node.input[0], TensorProto.FLOAT) == TensorProto.FLOAT, node.name


def test_a_layer_near_the_largest_float16_stays_in_float32(
    half: Any, model: TreeRCNN, frames: NDArray[np.uint8]
) -> None:
    graph = Graph(half)
    kinds = {
        name: value.data_type
        for name, value in graph.constants.items()
        if "mask_head.tower.convs" in name or "keypoint_head.tower.convs" in name
    }
    single = {name for name, kind in kinds.items() if kind == TensorProto.FLOAT}
    assert "model.mask_head.tower.convs.0.weight" in single
    assert "model.mask_head.tower.convs.1.weight" in single
    assert not any("keypoint_head" in name for name in single)
    session = onnxruntime.InferenceSession(
        half.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    names = output_names(masks=True, keypoints=True)
    outputs = dict(zip(names, session.run(None, {"image": frames[:1]}), strict=True))
    with torch.inference_mode():
        expected = model.detect(torch.from_numpy(frames[:1]))
    best, found = expected.boxes[0, 0].numpy(), outputs["boxes"][0, 0]
    assert np.abs(best - found).max() < 1.0
    assert np.abs(expected.masks[0, 0].numpy() - outputs["masks"][0, 0]).max() < 0.05
