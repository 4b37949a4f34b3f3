"""One image of a combined model file, run as if the file took this image alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edgetree.model_file.manifest import METADATA_KEY, Manifest, optional_inputs
from edgetree.model_file.safety_check import Shape
from edgetree.runtime.session import InferenceSession


class AloneSession:
    """The session of a combined file, shown one image and nothing in the other one.

    Its inputs and its manifest are those of the model that then runs.

    Args:
        session: Session of the combined file.
        manifest: Manifest of that file.
        image: What is shown, `colour` or `depth`, a key of `Manifest.alone`.
    """

    def __init__(self, session: InferenceSession, manifest: Manifest, image: str) -> None:
        self._session, self._image = session, image
        self._input = manifest.alone[image].input.name
        self._optional = optional_inputs(manifest)
        ((other, target),) = (each for each in manifest.graph_inputs.items() if each[0] != image)
        nothing = np.full((1, *target.image_shape), target.nothing, np.uint8)
        self._other: dict[str, NDArray[Any]] = {other: nothing}
        self.name = session.name
        self.provider = session.provider
        self.threads = session.threads
        self.metadata: Mapping[str, str] = {METADATA_KEY: manifest.alone[image].to_json()}
        self.output_shapes: Mapping[str, Shape] = session.output_shapes

    @property
    def input_shapes(self) -> Mapping[str, Shape]:
        """Shape of the image's input, and of those with a default."""
        shapes = self._session.input_shapes
        optional = {name: shapes[name] for name in self._optional}
        return {self._input: shapes[self._image], **optional}

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Run the graph; as `InferenceSession.run`."""
        given = dict(inputs)
        shown = {self._image: given.pop(self._input)}
        return self._session.run(shown | self._other | given)
