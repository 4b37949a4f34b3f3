"""Untrusted files: equal tensors from every format, one-line errors, and no code execution."""

import io
import os
import pickle
import re
import tracemalloc
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import save_file

from perceptree.errors import CheckpointError
from perceptree.models import load_checkpoint
from perceptree.models.weights.reading import read_weights

PROTOCOLS = (0, 1, 2, 3, 4, 5)


def arrays() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(4)
    return {
        "plain": rng.normal(size=(2, 3, 4)).astype(np.float32),
        "columns": np.asfortranarray(rng.normal(size=(3, 5)).astype(np.float32)),
        "turned": rng.normal(size=(2, 3, 4)).astype(np.float32).transpose(0, 2, 1),
        "every second": rng.normal(size=(6,)).astype(np.float32)[::2],
        "big end": rng.normal(size=(3,)).astype(">f4"),
        "half": rng.normal(size=(4,)).astype(np.float16),
        "double": rng.normal(size=(4,)),
        "one": np.array(2.5, np.float32),
        "whole": np.arange(5),
    }


def assert_equal_tensors(path: Path, expected: dict[str, np.ndarray]) -> None:
    found = read_weights(path)
    assert list(found) == list(expected)
    for name, value in expected.items():
        wanted = value.astype(np.float32) if value.dtype.kind == "f" else value
        assert found[name].dtype == (torch.float32 if value.dtype.kind == "f" else torch.int64)
        np.testing.assert_array_equal(found[name].numpy(), wanted, name)


def refused(path: Path) -> str:
    """The one-line error for a file, without the file's name."""
    with pytest.raises(CheckpointError) as caught:
        read_weights(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert len(text) < 500
    return text.removeprefix(f"{path}: ")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_pickle_of_any_protocol_gives_its_arrays(protocol: int, tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    content = {"model": OrderedDict(arrays()), "__author__": "them", "score": np.float64(0.5)}
    path.write_bytes(pickle.dumps(content, protocol))
    assert_equal_tensors(path, arrays())


def test_a_pickle_of_an_older_numpy_gives_its_arrays(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    values = {"model": {"plain": arrays()["plain"]}}
    text = pickle.dumps(values, 2)
    assert b"numpy._core" in text
    path.write_bytes(text.replace(b"numpy._core", b"numpy.core"))
    assert_equal_tensors(path, values["model"])


def test_a_pickle_of_python_2_gives_its_arrays(tmp_path: Path) -> None:
    raw = np.array([1.5, -2.0], "<f4").tobytes()
    text = (
        b"\x80\x02}U\x01acnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R"
        b"(K\x01K\x02\x85cnumpy\ndtype\nU\x02f4K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xff"
        b"J\xff\xff\xff\xffK\x00tb\x89U\x08" + raw + b"tbs."
    )
    path = tmp_path / "model.pkl"
    path.write_bytes(text)
    assert read_weights(path)["a"].tolist() == [1.5, -2.0]


@pytest.mark.parametrize("zipped", [True, False])
def test_both_formats_of_torch_give_their_tensors(zipped: bool, tmp_path: Path) -> None:
    values = {
        name: torch.tensor(value.astype(value.dtype.newbyteorder("=")))
        for name, value in arrays().items()
    }
    values["shared"] = torch.nn.Parameter(values["plain"][0])
    content = {
        "model": OrderedDict(values),
        "iteration": np.int64(9),
        "scheduler": {"last_lr": np.float64(0.1)},
        "optimizer": {"state": {0: {"momentum_buffer": torch.ones(2)}}},
    }
    path = tmp_path / "model.bin"
    torch.save(content, path, _use_new_zipfile_serialization=zipped)
    assert_equal_tensors(path, arrays() | {"shared": arrays()["plain"][0]})


def test_a_network_in_parallel_and_a_bare_state_are_read(tmp_path: Path) -> None:
    path = tmp_path / "model.pth"
    layer = torch.nn.Linear(2, 3)
    torch.save(torch.nn.Sequential(OrderedDict(module=layer)).state_dict(), path)
    assert sorted(read_weights(path)) == ["bias", "weight"]


class Hostile:
    """Creates a file if it is unpickled by an unsafe reader."""

    def __init__(self, touched: Path) -> None:
        self.touched = touched

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch '{self.touched}'",)


Writer = Callable[[object, Path], None]
WRITERS: dict[str, Writer] = {
    "pickle 2": lambda content, path: path.write_bytes(pickle.dumps(content, 2)) and None,
    "pickle 5": lambda content, path: path.write_bytes(pickle.dumps(content, 5)) and None,
    "torch": lambda content, path: torch.save(content, path),
    "old torch": lambda content, path: torch.save(
        content, path, _use_new_zipfile_serialization=False
    ),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_hostile_file_is_refused_and_nothing_runs(writer: str, tmp_path: Path) -> None:
    path, touched = tmp_path / "model.pkl", tmp_path / "touched"
    WRITERS[writer]({"model": {"a": Hostile(touched)}}, path)
    text = refused(path)
    assert re.search(r"refused, it would call (posix|nt|os)\.system", text)
    assert not touched.exists()
    if writer.startswith("pickle"):  # an unsafe reader would have made it
        pickle.loads(path.read_bytes())
        assert touched.exists()


GLOBALS = {
    "builtins eval": b"cbuiltins\neval\n(Vopen('{}', 'w')\ntR.",
    "numpy load": b"cnumpy\nload\n(V{}\ntR.",
    "dotted": b"\x80\x04\x8c\x05numpy\x8c\x0endarray.tofile\x93.",
    "instance": b"(ios\nsystem\n.",
    "new object": b"\x80\x02csubprocess\nPopen\n)\x81.",
    "copyreg": b"\x80\x02ccopy_reg\n_reconstructor\n.",
}


@pytest.mark.parametrize("name", GLOBALS)
def test_any_other_name_is_refused(name: str, tmp_path: Path) -> None:
    path, touched = tmp_path / "model.pkl", tmp_path / "touched"
    path.write_bytes(GLOBALS[name].replace(b"{}", str(touched).encode()))
    assert "refused, it would call " in refused(path)
    assert not touched.exists()


def test_a_pickle_cannot_change_what_stands_for_numpy(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    for name in (b"cnumpy\ndtype\n", b"c_codecs\nencode\n", b"ccollections\nOrderedDict\n"):
        path.write_bytes(b"\x80\x02" + name + b"N}U\x05buildU\x01xs\x86b.")
        refused(path)
    path.write_bytes(pickle.dumps({"model": arrays()}, 2))
    assert_equal_tensors(path, arrays())


def array_pickle(shape: tuple[int, ...], code: str = "f4", raw: bytes = b"\0" * 16) -> bytes:
    """A pickle of one array with a possibly wrong description."""
    text = io.BytesIO()
    text.write(b"\x80\x04}X\x01\x00\x00\x00acnumpy._core.multiarray\n_reconstruct\n")
    text.write(b"cnumpy\nndarray\nK\x00\x85C\x01b\x87R(K\x01")
    text.write(pickle.dumps(shape, 2)[2:-1])
    text.write(
        f"cnumpy\ndtype\nV{code}\n".encode() + b"\x89\x88\x87R(K\x03V<\nNNNK\x00K\x00K\x00tb"
    )
    text.write(b"\x89C" + bytes([len(raw)]) + raw + b"tbs.")
    return text.getvalue()


LIES = {
    "true": ((2, 2), "f4", None),
    "huge": ((2**20, 2**20, 2**20), "f4", "16 bytes for the shape"),
    "overflowing": ((2**62, 2**62), "f4", "16 bytes for the shape"),
    "negative": ((-2, -2), "f4", "an array with an invalid shape"),
    "too short": ((5,), "f4", "16 bytes for the shape (5,), expected 20"),
    "objects": ((2,), "O8", "neither a float nor an integer"),
    "text": ((2,), "U2", "neither a float nor an integer"),
    "complex": ((2,), "c8", "neither a float nor an integer"),
    "not finite": ((2, 2), "f4", "numbers that are not finite"),
}


@pytest.mark.parametrize("lie", LIES)
def test_an_array_that_lies_about_itself_is_refused(lie: str, tmp_path: Path) -> None:
    shape, code, expected = LIES[lie]
    path = tmp_path / "model.pkl"
    raw = np.full(4, np.nan, "<f4").tobytes() if lie == "not finite" else b"\0" * 16
    path.write_bytes(array_pickle(shape, code, raw))
    if expected is None:
        assert read_weights(path)["a"].shape == shape
        return
    text = refused(path)
    assert text.startswith("a holds ")
    assert expected in text


def test_a_tensor_that_its_file_does_not_fill_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.pth"
    torch.save({"a": torch.zeros(1).expand(10**6, 10**6)}, path)
    assert "1 tensors of 4000000000000 bytes in a file of" in refused(path)
    torch.save({"a": torch.zeros(3, device="meta")}, path)
    assert "a is not a plain tensor" in refused(path)
    torch.save({"a": torch.eye(3).to_sparse()}, path)
    assert "a is not a plain tensor" in refused(path)


CLAIMS = {
    "array": array_pickle((2**20, 2**20)),
    "bytes": b"\x80\x05\x8e" + (2**33).to_bytes(8, "little") + b"abc.",
    "bytearray": b"\x80\x05\x96" + (2**33).to_bytes(8, "little") + b"abc.",
    "index": b"\x80\x02}r\xff\xff\xff\x0f.",
    "index in text": b"(dp268435455\n.",
}


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_claim_sets_no_memory_aside(claim: str, tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(CLAIMS[claim])
    tracemalloc.start()
    try:
        refused(path)
        assert tracemalloc.get_traced_memory()[1] < 2**22
    finally:
        tracemalloc.stop()


def test_content_that_is_no_weights_is_described(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    for content, expected in (
        ([1, 2], "holds a list, expected tensors by name"),
        ({"epoch": 3, "lr": 0.1}, "holds epoch, lr, expected tensors by name"),
        ({}, "holds nothing"),
        ({"model": {"a": np.zeros(1, np.float32), "b": "x"}}, "b is a str, expected a tensor"),
        ({"a\nb": np.zeros(1, np.float32)}, "a tensor is named 'a b', expected printable text"),
        ({"x" * 1000: np.zeros(1, np.float32)}, "expected printable text"),
    ):
        path.write_bytes(pickle.dumps(content))
        assert expected in refused(path)
    torch.save({"model": {"a": torch.tensor([1.0, np.inf]), "b": torch.zeros(1)}}, path)
    assert refused(path) == "a holds numbers that are not finite"


def test_what_is_no_checkpoint_at_all_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    assert refused(path).startswith("no such file")
    assert refused(tmp_path).startswith("is a folder")
    path.write_bytes(b"")
    assert refused(path).startswith("is empty, expected")
    save_file({"a": torch.zeros(2)}, path)
    assert refused(path).startswith("is a safetensors file")
    path.write_text("<html>404</html>")
    assert refused(path).startswith("not a readable checkpoint")


def test_pipes_and_devices_are_refused_and_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "model.pth"
    os.mkfifo(path)
    pipe = os.open(path, os.O_RDWR)  # with content, so that a reader would not wait either
    try:
        os.write(pipe, b"\0" * 1000)
        assert refused(path).startswith("is a pipe, socket or device, expected a .pth or .pkl")
        with pytest.raises(CheckpointError, match="is a pipe, socket or device, expected"):
            load_checkpoint(path)
    finally:
        os.close(pipe)
    assert refused(Path("/dev/zero")).startswith("is a pipe, socket or device")
    with pytest.raises(CheckpointError, match="is a folder, expected"):
        load_checkpoint(tmp_path)


def test_a_changed_byte_in_a_zip_file_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "model.pth"
    torch.save({"model": {"a": torch.arange(1.0, 500.0)}}, path)
    whole = bytearray(path.read_bytes())
    number = whole.index(np.float32(100.0).tobytes())
    whole[number] ^= 1  # 100.00001
    path.write_bytes(whole)
    assert "a damaged zip file: Bad CRC-32 for file 'model/data/0'" in refused(path)


def test_a_zip_file_without_checksums_is_read(
    tmp_path: Path,
) -> None:
    path = tmp_path / "model.pth"
    torch.serialization.set_crc32_options(False)
    try:
        torch.save({"model": {"a": torch.ones(500)}}, path)
    finally:
        torch.serialization.set_crc32_options(True)
    assert read_weights(path)["a"].sum() == 500


def whole_file(writer: str, path: Path) -> bytes:
    """A small valid checkpoint in one of the formats; it is written to ``path``."""
    tensors: dict[str, Any] = {"a": torch.ones(3, 4), "b": torch.ones(5)}
    if writer.startswith("pickle"):
        tensors = {name: value.numpy() for name, value in tensors.items()}
    WRITERS[writer]({"model": tensors, "iteration": np.int64(3)}, path)
    return path.read_bytes()


@pytest.mark.parametrize("writer", WRITERS)
def test_a_file_cut_short_is_refused_in_one_line(writer: str, tmp_path: Path) -> None:
    path = tmp_path / "model.bin"
    whole = whole_file(writer, path)
    for length in range(0, len(whole) - 1, 1 + len(whole) // 150):
        path.write_bytes(whole[:length])
        refused(path)


@pytest.mark.parametrize("writer", WRITERS)
@settings(max_examples=150)
@given(data=st.data())
def test_a_garbled_file_is_read_or_refused_in_one_line(
    writer: str, data: st.DataObject, tmp_path: Path
) -> None:
    path = tmp_path / "model.bin"
    garbled = bytearray(whole_file(writer, path))
    for position in data.draw(st.lists(st.integers(0, len(garbled) - 1), min_size=1, max_size=3)):
        garbled[position] = data.draw(st.integers(0, 255))
    path.write_bytes(garbled)
    message = ""
    try:
        read_weights(path)
    except CheckpointError as error:
        message = str(error)
    assert "\n" not in message
