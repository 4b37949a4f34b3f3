"""What a model file of a few bytes may cost while onnxruntime opens it: memory and time."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from edgetree.errors import ModelFileError
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.model_file.safety_check import read_model_file
from edgetree.runtime.providers import SessionSettings
from edgetree.runtime.session import OrtSession

ONE = np.ones(1, np.float32)
MOST = 4_900


def write(
    path: Path, nodes: list[Node], x: TensorType, y: TensorType, **constants: np.ndarray
) -> Path:
    path.write_bytes(onnx_bytes(nodes, inputs={"x": x}, outputs={"y": y}, constants=constants))
    return path


@pytest.mark.parametrize("reshaped", [False, True])
def test_constants_are_not_expanded_to_the_size_of_a_large_tensor(
    reshaped: bool, tmp_path: Path
) -> None:
    size = 2**27
    nodes = [Node("Reshape", ("x", "n"), ("r",))] * reshaped
    nodes += [
        Node("Shape", ("r" if reshaped else "x",), ("s",)),
        Node("Expand", ("one", "s"), ("e",)),
        Node("Add", ("x", "e"), ("y",)),
    ]
    ends = TensorType("float32", ("many",) if reshaped else (size,))
    path = write(tmp_path / "trees.onnx", nodes, ends, ends, one=ONE, n=np.array([size]))
    with pytest.raises(ModelFileError, match=r"Expand that enlarges its input to or by 1\.34218e"):
        read_model_file(path)


def large_by_broadcast(path: Path, side: int) -> Path:
    """A file with a constant of the size of a column and a row that are added."""
    nodes = [
        Node("Reshape", ("x", "row"), ("r",)),
        Node("Add", ("x", "r"), ("b",)),
        Node("Shape", ("b",), ("s",)),
        Node("Expand", ("one", "s"), ("e",)),
        Node("Add", ("b", "e"), ("y",)),
    ]
    column, out = TensorType("float32", (side, 1)), TensorType("float32", ("h", "w"))
    return write(path, nodes, column, out, one=ONE, row=np.array([1, side]))


_OPEN = """
import dataclasses, pathlib, sys
from basetree.files import current_limits, set_limits
from edgetree.runtime.providers import SessionSettings
from edgetree.runtime.session import OrtSession

def peak_mib():
    status = pathlib.Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024

set_limits(dataclasses.replace(current_limits(), model_memory_bytes=int(sys.argv[2])))
before = peak_mib()
assert OrtSession(pathlib.Path(sys.argv[1]), SessionSettings(threads=1)).input_shapes
print(peak_mib() - before)
assert bytes(2**30)  # the limit ends with the opening
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is limited on Linux")
@pytest.mark.parametrize(
    ("side", "limit", "most_mib"), [(16_000, 2**33, 700), (10_000, 2**28, 300), (9, 2**33, 100)]
)
def test_opening_a_small_file_takes_limited_memory(
    side: int, limit: int, most_mib: float, tmp_path: Path
) -> None:
    path = large_by_broadcast(tmp_path / "trees.onnx", side)
    command = [sys.executable, "-c", _OPEN, str(path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert float(done.stdout) < most_mib


def chain(operator: str, *more: str) -> list[Node]:
    """Operators of which each takes the result of the one before."""
    names = ["x", *(f"t{number}" for number in range(MOST - 1)), "y"]
    return [Node(operator, (names[n], *more), (names[n + 1],)) for n in range(MOST)]


def dequantized() -> list[Node]:
    """Sums with constants that are computed from others."""
    half = MOST // 2
    names = ["x", *(f"t{number}" for number in range(half - 1)), "y"]
    nodes = [Node("DequantizeLinear", (f"c{n}", "scale"), (f"d{n}",)) for n in range(half)]
    return nodes + [Node("Add", (names[n], f"d{n}"), (names[n + 1],)) for n in range(half)]


@pytest.mark.parametrize(
    "nodes",
    [
        chain("Conv", "w"),
        chain("Transpose"),
        [Node("Relu", ("x",), (f"t{number}",)) for number in range(MOST)]
        + [Node("Relu", ("x",), ("y",))],
        dequantized(),
    ],
    ids=["a chain of convolutions", "a chain", "all of one tensor", "computed constants"],
)
def test_the_most_operators_are_opened_in_time(nodes: list[Node], tmp_path: Path) -> None:
    constants = {f"c{number}": np.ones(8, np.int8) for number in range(MOST // 2)}
    constants |= {"w": np.ones((1, 1, 1, 1), np.float32), "scale": np.array(0.1, np.float32)}
    image = TensorType("float32", (1, 1, 8, 8))
    out = TensorType("float32", ("n", "c", "h", "w"))
    path = write(tmp_path / "trees.onnx", nodes, image, out, **constants)
    begin = time.process_time()
    assert OrtSession(path, SessionSettings(threads=1)).input_shapes
    assert time.process_time() - begin < 5
