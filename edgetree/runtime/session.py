"""Sessions run a model file: onnxruntime's, and a fake one for tests that need no model."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.model_file.safety_check import Shape, read_model_file
from edgetree.runtime.ort_session import open_session, placement_of, reason_of
from edgetree.runtime.providers import CPU, SessionSettings, import_onnxruntime

__all__ = ["FakeSession", "InferenceSession", "OrtSession", "usable_cores"]

Arrays = Mapping[str, NDArray[Any]]


class InferenceSession(Protocol):
    """What the runtime needs of whatever runs the graph. `run` may be called from many threads."""

    @property
    def name(self) -> str:
        """What errors call the model, such as its file."""

    @property
    def metadata(self) -> Mapping[str, str]:
        """The model file's metadata, `METADATA_KEY` among them."""

    @property
    def provider(self) -> str:
        """What really runs the graph: a name of `edgetree.runtime.providers.PROVIDERS`."""

    @property
    def threads(self) -> int:
        """Threads of one inference."""

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shape of each input; a text stands for a size that is free."""

    @property
    def output_shapes(self) -> Mapping[str, Shape]:
        """Shape of each output, in the graph's order; likewise."""

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """All outputs by name."""


def usable_cores() -> int:
    """Number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class OrtSession:
    """A model file in onnxruntime.

    Args:
        path: the .onnx file; `safety_check` reads it before onnxruntime opens it.
        settings: how it is opened; on the processor if None.

    Raises:
        ModelFileError: the file is missing, no ONNX model, or one that may not be opened.
        InputError: the provider asked for is not installed, did not start or takes no part of the
            graph; or the cache folder cannot be made.
        MissingDependency: onnxruntime is not installed.
    """

    def __init__(self, path: Path, settings: SessionSettings | None = None) -> None:
        settings = settings or SessionSettings()
        read_model_file(path)
        self._name = str(path)
        self._threads = settings.threads or usable_cores()
        self._session, self._provider = open_session(path, settings, self._threads)
        self._metadata: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        self._inputs = {item.name: tuple(item.shape) for item in self._session.get_inputs()}
        self._outputs = {item.name: tuple(item.shape) for item in self._session.get_outputs()}
        self._turn = threading.Lock() if self._provider.one_at_a_time else nullcontext()

    @property
    def name(self) -> str:
        """The model's file."""
        return self._name

    @property
    def metadata(self) -> Mapping[str, str]:
        """The model file's metadata."""
        return self._metadata

    @property
    def provider(self) -> str:
        """The provider in use, which takes at least a part of the graph."""
        return self._provider.name

    @property
    def placement(self) -> dict[str, dict[str, int]]:
        """Which provider takes which part of the graph: number of nodes by provider and operator.

        What the provider in use does not know runs on "cpu", and costs copies. Empty where only
        the processor is in use, and with an onnxruntime too old to tell.
        """
        return placement_of(self._session, self._provider)

    @property
    def threads(self) -> int:
        """Threads of one inference."""
        return self._threads

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shape of each input."""
        return self._inputs

    @property
    def output_shapes(self) -> Mapping[str, Shape]:
        """Shape of each output."""
        return self._outputs

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """All outputs by name.

        Raises:
            ModelFileError: onnxruntime cannot run the model on these inputs.
        """
        try:
            with self._turn:
                values = self._run(inputs)
        except Exception as error:  # onnxruntime's errors share no base of their own
            raise ModelFileError(
                f"model {self._name} failed as it ran on {self.provider!r} ({reason_of(error)}):"
                " expected a file made by `edgetree export`, and memory enough for it"
            ) from error
        return dict(zip(self._outputs, values, strict=True))

    def _run(self, inputs: Arrays) -> list[NDArray[Any]]:
        """The outputs; on a device of its own, inputs and outputs are copied once each."""
        device = self._provider.io_device
        values: list[NDArray[Any]]
        if device is None:
            values = self._session.run(None, dict(inputs))
        else:
            make = import_onnxruntime().OrtValue.ortvalue_from_numpy
            binding = self._session.io_binding()
            for name, array in inputs.items():
                binding.bind_ortvalue_input(name, make(np.ascontiguousarray(array), device, 0))
            for name in self._outputs:
                binding.bind_output(name, "cpu")
            self._session.run_with_iobinding(binding)
            values = binding.copy_outputs_to_cpu()
        return values


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

        def for_each_image(inputs: Arrays) -> Arrays:
            images = len(inputs.get(manifest.input.name, (None,)))
            return {name: np.repeat(values, images, axis=0) for name, values in outputs.items()}

        return cls(manifest, for_each_image)

    @property
    def name(self) -> str:
        """The model's own name."""
        return self.manifest.name

    @property
    def metadata(self) -> Mapping[str, str]:
        """The manifest, as a model file carries it."""
        return {METADATA_KEY: self.manifest.to_json()}

    @property
    def provider(self) -> str:
        """The processor."""
        return CPU

    @property
    def threads(self) -> int:
        """One: there is nothing to do."""
        return 1

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """The one input of the manifest."""
        return {self.manifest.input.name: ("batch", *self.manifest.input.image_shape)}

    @property
    def output_shapes(self) -> Mapping[str, Shape]:
        """The outputs of the manifest."""
        return {output.name: ("batch", *output.shape[1:]) for output in self.manifest.outputs}

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """The fixed outputs, or those of the function."""
        self.inputs = dict(inputs)
        return dict(self._outputs(inputs) if callable(self._outputs) else self._outputs)
