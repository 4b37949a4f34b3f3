"""Inference sessions: onnxruntime's, and a fake session for tests without a model."""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float32
from edgetree.detections import MASK_SIZE
from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import METADATA_KEY, Manifest, optional_inputs
from edgetree.model_file.safety_check import (
    Shape,
    check_content,
    check_is_file,
    read_model_file,
)
from edgetree.runtime.ort_session import open_session, placement_of, reason_of
from edgetree.runtime.providers import CPU, SessionSettings, import_onnxruntime
from edgetree.signing.verify import model_if_signed

Arrays = Mapping[str, NDArray[Any]]


class InferenceSession(Protocol):
    """Interface of the sessions that `TreeDetector` uses. `run` must be thread-safe."""

    @property
    def name(self) -> str:
        """Name of the model in error messages, such as its file."""

    @property
    def metadata(self) -> Mapping[str, str]:
        """The model file's metadata, including `METADATA_KEY`."""

    @property
    def provider(self) -> str:
        """The provider in use, a name in `edgetree.runtime.PROVIDERS`."""

    @property
    def threads(self) -> int:
        """Threads of one inference."""

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shape of each input; dynamic sizes are given by their name. Those with a default too."""

    @property
    def output_shapes(self) -> Mapping[str, Shape]:
        """Shape of each output, likewise, in the graph's order."""

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """Run the graph on inputs by name; returns all outputs by name."""


def usable_cores() -> int:
    """Number of CPU cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class OrtSession:
    """A model file opened in onnxruntime. Thread-safe.

    A process that is forked gets its memory, but not onnxruntime's threads: there it can be used
    with one thread on the CPU alone.

    Args:
        path: The .onnx file. It must pass `edgetree.model_file.safety_check` before it is opened,
            and have an accepted signature where one is required, see `edgetree.signing`.
        settings: Provider and options; the default settings if None.
        content: The content of a model that the caller made itself, which needs no signature. The
            path is then only a name for messages.
        adjust: Called with the `onnxruntime.SessionOptions` before the model is loaded, for
            measurements.

    Attributes:
        name: Path of the model file.
        metadata: The model file's metadata.
        provider: The provider in use, which runs at least a part of the graph.
        threads: Threads of one inference.
        input_shapes: Shape of each input, also of those that have a default.
        output_shapes: Shape of each output.

    Raises:
        ModelFileError: The file is missing, is not an ONNX model or fails the safety check.
        SignatureError: a signature is required, and missing or not accepted.
        InputError: The provider cannot be used, or the cache folder cannot be created.
        MissingPackage: Onnxruntime is not installed.
    """

    def __init__(
        self,
        path: Path,
        settings: SessionSettings | None = None,
        *,
        content: bytes | None = None,
        adjust: Callable[[Any], None] = lambda _: None,
    ) -> None:
        settings = settings or SessionSettings()
        accepted = None
        if content is None:
            check_is_file(path)
            accepted = model_if_signed(path, settings.require_signature)
            content = None if accepted is None else accepted.content
        if content is None:
            read_model_file(path)
        else:
            check_content(content, path)
        self.name = str(path)
        self.threads = settings.threads or usable_cores()
        self._session, self._provider = open_session(path, settings, self.threads, content, adjust)
        if accepted is not None:
            accepted.record_use()
        self.provider = self._provider.name
        self.metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        self.input_shapes, self.output_shapes = (
            {item.name: tuple(item.shape) for item in items}
            for items in (
                [*self._session.get_inputs(), *self._session.get_overridable_initializers()],
                self._session.get_outputs(),
            )
        )
        self._turn = threading.Lock() if self._provider.one_at_a_time else nullcontext()
        self._process = os.getpid()
        _open_sessions.add(self)

    @property
    def placement(self) -> dict[str, dict[str, int]]:
        """Number of the graph's nodes by provider and operator.

        Operators that the provider does not support run on "cpu", at the cost of copies between
        devices. Empty if only the CPU is in use or the version of onnxruntime does not tell.
        """
        return placement_of(self._session, self._provider)

    def end_profiling(self) -> Path:
        """End the profile that `adjust` switched on; returns the file that onnxruntime wrote."""
        return Path(self._session.end_profiling())

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """Run the graph on inputs by name; returns all outputs by name.

        Raises:
            ModelFileError: Onnxruntime cannot run the model on these inputs, or it was opened with
                several threads before this process was forked.
        """
        if self._process != os.getpid() and (self.threads > 1 or self.provider != CPU):
            raise ModelFileError(
                f"model {self.name} was opened in process {self._process}, and this is process"
                f" {os.getpid()}, forked from it without the threads of onnxruntime: expected it to"
                " be opened in each process, or processes that multiprocessing starts by 'spawn'"
            )
        try:
            with self._turn:
                values = self._run(inputs)
        except Exception as error:  # onnxruntime's errors have no common base class
            raise ModelFileError(
                f"model {self.name} failed to run on {self.provider!r} ({reason_of(error)}):"
                " expected a file made by `edgetree export`, and enough memory"
            ) from error
        return dict(zip(self.output_shapes, values, strict=True))

    def _run(self, inputs: Arrays) -> list[NDArray[Any]]:
        """The outputs; for a provider with its own memory, arrays are copied once each way."""
        device = self._provider.io_device
        values: list[NDArray[Any]]
        if device is None:
            values = self._session.run(None, dict(inputs))
        else:
            make = import_onnxruntime().OrtValue.ortvalue_from_numpy
            binding = self._session.io_binding()
            for name, array in inputs.items():
                binding.bind_ortvalue_input(name, make(np.ascontiguousarray(array), device, 0))
            for name in self.output_shapes:
                binding.bind_output(name, "cpu")
            self._session.run_with_iobinding(binding)
            values = binding.copy_outputs_to_cpu()
        return values


_open_sessions: weakref.WeakSet[OrtSession] = weakref.WeakSet()


def _never_close() -> None:
    """Keep the sessions of a forked process for ever: to close them, they wait for lost threads."""
    import ctypes

    for session in _open_sessions:
        for part in (session._session, getattr(session._session, "_sess", None)):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(part))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_never_close)


class FakeSession:
    """A session without a model, for tests.

    Args:
        manifest: The manifest of the imitated model.
        outputs: Fixed outputs by name, or a function from inputs to outputs.

    Attributes:
        inputs: The inputs of the last `run`.
    """

    def __init__(self, manifest: Manifest, outputs: Arrays | Callable[[Arrays], Arrays]) -> None:
        self.manifest = manifest
        self.inputs: dict[str, NDArray[Any]] = {}
        self._outputs = outputs

    @classmethod
    def with_trees(
        cls,
        manifest: Manifest,
        boxes: Float32,
        scores: Float32,
        keypoints: Float32 | None = None,
        masks: Float32 | None = None,
        keypoint_stds: Float32 | None = None,
    ) -> FakeSession:
        """A session that returns the same trees for every image.

        Args:
            manifest: The manifest of the imitated model.
            boxes: (N, 4) x0, y0, x1, y1 in pixels of the input.
            scores: (N,) in descending order.
            keypoints: (N, 5, 3) x, y in pixels of the input, score; zeros if None.
            masks: (N, 28, 28) probabilities; ones if None.
            keypoint_stds: (N, 5, 2) standard deviations in pixels of the input; zeros if None.
        """
        count = len(scores)
        given: dict[str, Float32 | None] = {
            "boxes": boxes,
            "scores": scores,
            "keypoints": keypoints,
            "keypoint_stds": keypoint_stds,
            "masks": np.ones((count, MASK_SIZE, MASK_SIZE), np.float32) if masks is None else masks,
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
        """The model's name in the manifest."""
        return self.manifest.name

    @property
    def metadata(self) -> Mapping[str, str]:
        """Metadata with the manifest, as in a model file."""
        return {METADATA_KEY: self.manifest.to_json()}

    @property
    def provider(self) -> str:
        """Always "cpu"."""
        return CPU

    @property
    def threads(self) -> int:
        """Always 1."""
        return 1

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shapes of the manifest's inputs."""
        images: dict[str, Shape] = {
            each.name: ("batch", *each.image_shape) for each in self.manifest.graph_inputs.values()
        }
        return images | optional_inputs(self.manifest)

    @property
    def output_shapes(self) -> Mapping[str, Shape]:
        """Shapes of the manifest's outputs."""
        return {output.name: ("batch", *output.shape[1:]) for output in self.manifest.outputs}

    def run(self, inputs: Arrays) -> dict[str, NDArray[Any]]:
        """The fixed outputs, or those that the function makes from `inputs`."""
        self.inputs = dict(inputs)
        return dict(self._outputs(inputs) if callable(self._outputs) else self._outputs)
