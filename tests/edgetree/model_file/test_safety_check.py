"""Damaged and malicious model files are rejected before onnxruntime opens them."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import Manifest
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.detector import TreeDetector, default_model

ModelWriter = Callable[..., Path]


def _part(field: int, content: bytes) -> bytes:
    """A protobuf field with bytes as its value."""
    head, size = bytearray([field << 3 | 2]), len(content)
    while size > 0x7F:
        head.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes([*head, size]) + content


def test_dynamic_sizes_are_read_by_their_names(
    rgb_manifest: Manifest, write_model: ModelWriter
) -> None:
    found = read_model_file(write_model(rgb_manifest))
    assert found.input_shapes == {"image": ("batch", 384, 640, 3)}


@pytest.mark.parametrize(
    "tensor",
    [b"\x70\x81\x80\x80\x80\x10", b"\xf0\x80\x80\x80\x10\x01"],
    ids=["location of 33 bits", "field number of 33 bits"],
)
def test_numbers_of_more_than_32_bits_hide_no_external_data(tensor: bytes, tmp_path: Path) -> None:
    path = tmp_path / "trees.onnx"
    path.write_bytes(_part(7, _part(5, tensor)))
    with pytest.raises(ModelFileError, match="stores weights in another file"):
        read_model_file(path)


def test_a_file_of_very_many_fields_is_rejected_quickly(tmp_path: Path) -> None:
    path = tmp_path / "trees.onnx"
    path.write_bytes(b"\x08\x01" * 1_000_001)
    with pytest.raises(ModelFileError, match="more than 1000000 fields"):
        read_model_file(path)


def test_deeply_nested_graphs_are_checked(tmp_path: Path) -> None:
    graph = _part(5, b"\x70\x01")  # weights in another file
    for _ in range(3000):  # more than Python's recursion limit
        graph = _part(1, _part(5, _part(6, graph)))
    path = tmp_path / "trees.onnx"
    path.write_bytes(_part(7, graph))
    with pytest.raises(ModelFileError, match="stores weights in another file"):
        read_model_file(path)


@pytest.mark.parametrize("share", [0.001, 0.3, 0.9, 0.9999])
def test_a_truncated_file_is_rejected(share: float, tmp_path: Path) -> None:
    content = default_model("depth").read_bytes()
    path = tmp_path / "trees.onnx"
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(ModelFileError, match=r"trees\.onnx is not an ONNX model .*truncated"):
        read_model_file(path)


def test_damaged_files_raise_only_model_file_errors(
    rgb_manifest: Manifest, write_model: ModelWriter, tmp_path: Path
) -> None:
    rng = random.Random(0)
    whole = write_model(rgb_manifest).read_bytes()
    path = tmp_path / "damaged.onnx"
    image = np.zeros((40, 64, 3), np.uint8)
    messages = []
    for round_ in range(300):
        content = bytearray(whole)
        if round_ % 3 == 0:
            del content[rng.randrange(len(content)) :]
        else:
            # The middle of this file is mostly zeros; its structure is at both ends.
            places = [*range(600), *range(len(content) - 3000, len(content))]
            for _ in range(rng.choice((1, 2, 16))):
                content[rng.choice(places)] ^= 1 << rng.randrange(8)
        path.write_bytes(content)
        try:
            TreeDetector.load(path, threads=1).detect(image)
        except ModelFileError as error:
            messages.append(str(error))
    assert 100 < len(messages) < 300
    assert [message for message in messages if "\n" in message] == []
