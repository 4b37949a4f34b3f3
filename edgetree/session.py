"""Sessions run a model file: onnxruntime's, and a fake one for tests that need no model."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from edgetree.errors import MissingDependency, ModelFileError
from edgetree.manifest import METADATA_KEY, Manifest

__all__ = ["FakeSession", "InferenceSession", "OrtSession", "usable_cores"]

Arrays = Mapping[str, NDArray[Any]]
Shape = tuple[int | str, ...]


class InferenceSession(Protocol):
    """What the runtime needs of whatever runs the graph."""

    @property
    def metadata(self) -> Mapping[str, str]:
        """The model file's metadata, `METADATA_KEY` among them."""

    @property
    def threads(self) -> int:
        """Threads of one inference."""

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shape of each input; a text stands for a size that is free."""

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs."""

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """All outputs by name."""


def usable_cores() -> int:
    """Number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class OrtSession:
    """A model file in onnxruntime, on the processor.

    Args:
        path: the .onnx file.
        threads: threads of one inference; None takes all cores that this process may use.
        spinning: let idle threads spin. It shortens an inference a little and keeps the cores
            busy between two, which the machine's other programs pay for; so it is off.

    Raises:
        ModelFileError: the file is missing or no ONNX model.
        MissingDependency: onnxruntime is not installed.
    """

    def __init__(self, path: Path, *, threads: int | None = None, spinning: bool = False) -> None:
        if threads is not None and threads < 1:
            raise ValueError(f"threads is {threads}: expected 1 or more")
        if not path.is_file():
            kind = "a folder" if path.is_dir() else "not there"
            raise ModelFileError(f"model {path} is {kind}: expected an .onnx file")
        self._threads = threads or usable_cores()
        self._session = _open(path, self._threads, spinning)
        self._metadata: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        self._inputs = {item.name: tuple(item.shape) for item in self._session.get_inputs()}
        self._outputs = tuple(item.name for item in self._session.get_outputs())

    @property
    def metadata(self) -> Mapping[str, str]:
        """The model file's metadata."""
        return self._metadata

    @property
    def threads(self) -> int:
        """Threads of one inference."""
        return self._threads

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shape of each input."""
        return self._inputs

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self._outputs

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """All outputs by name."""
        values = self._session.run(None, dict(inputs))
        return dict(zip(self._outputs, values, strict=True))


def _open(path: Path, threads: int, spinning: bool) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingDependency(
            "onnxruntime is not installed: install edgetree[cpu] or, for an NVIDIA GPU,"
            " edgetree[gpu]; one of the two"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", str(int(spinning)))
    try:
        return onnxruntime.InferenceSession(
            str(path), sess_options=options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime's errors share no base of their own
        reason = str(error).strip().splitlines()[0].rpartition("failed:")[2]
        raise ModelFileError(
            f"model {path} is not an ONNX model that onnxruntime can load ({reason}):"
            " expected a file made by `edgetree export`"
        ) from error


class FakeSession:
    """Answers like a model: fixed outputs, or what a function makes of the inputs.

    Args:
        manifest: what the model says about itself.
        outputs: the outputs by name, or a function from the inputs to them.

    `inputs` keeps what the last `run` was given.
    """

    def __init__(self, manifest: Manifest, outputs: Arrays | Callable[[Arrays], Arrays]) -> None:
        self.manifest = manifest
        self.inputs: dict[str, NDArray[Any]] = {}
        self._outputs = outputs

    @classmethod
    def with_trees(
        cls,
        manifest: Manifest,
        boxes: NDArray[np.float32],
        scores: NDArray[np.float32],
        keypoints: NDArray[np.float32] | None = None,
        masks: NDArray[np.float32] | None = None,
    ) -> FakeSession:
        """A model that finds these trees in every image.

        Args:
            manifest: its outputs say how many rows there are.
            boxes: (N, 4) xyxy px of the input.
            scores: (N,) descending.
            keypoints: (N, 5, 3) x px, y px, score; zeros if None.
            masks: (N, 28, 28) probabilities; ones if None.
        """
        count = len(scores)
        given: dict[str, NDArray[np.float32] | None] = {
            "boxes": boxes,
            "scores": scores,
            "keypoints": keypoints,
            "masks": np.ones((count, 28, 28), np.float32) if masks is None else masks,
        }
        outputs: dict[str, NDArray[Any]] = {}
        for output in manifest.outputs:
            shape = tuple(1 if size == "B" else int(size) for size in output.shape)
            outputs[output.name] = np.zeros(shape, dtype=output.dtype)
            rows = given.get(output.name)
            if rows is not None:
                outputs[output.name][0, :count] = rows
        outputs["num_detections"][0] = count
        return cls(manifest, outputs)

    @property
    def metadata(self) -> Mapping[str, str]:
        """The manifest, as a model file carries it."""
        return {METADATA_KEY: self.manifest.to_json()}

    @property
    def threads(self) -> int:
        """One: there is nothing to do."""
        return 1

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """The one input of the manifest."""
        return {self.manifest.input.name: ("batch", *self.manifest.input.image_shape)}

    @property
    def output_names(self) -> tuple[str, ...]:
        """The outputs of the manifest."""
        return self.manifest.output_names

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """The fixed outputs, or those of the function."""
        self.inputs = dict(inputs)
        return dict(self._outputs(inputs) if callable(self._outputs) else self._outputs)
