"""The sample frames that come with the package: image, depth, camera, and the truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, read_depth
from edgetree.frames.sources import read_image

__all__ = ["SampleFrame", "SampleTree", "sample_frames"]


@dataclass(frozen=True, eq=False)
class SampleTree:
    """What is true of one tree, from the simulator.

    Attributes:
        box_px: (4,) float32 x0, y0, x1, y1 around the visible lower stem.
        keypoints_px: (5, 3) float32 x, y, flag (2 visible, 1 hidden, 0 outside the
            frame, and then x and y are 0).
        diameter_m: of the stem, on the section through the diameter keypoints.
        cut_height_m: of the felling cut above the ground on the uphill side.
        distance_m: range from the camera's centre to the stem's axis at the cut.
        inclination_deg: of the axis from the vertical.
        visible_fraction: part of the lower stem that nothing hides, 0 to 1.
        species: name of the kind of tree.
    """

    box_px: NDArray[np.float32]
    keypoints_px: NDArray[np.float32]
    diameter_m: float
    cut_height_m: float
    distance_m: float
    inclination_deg: float
    visible_fraction: float
    species: str

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> SampleTree:
        """Read the JSON object of one tree."""
        return cls(
            box_px=np.array(data["box_px"], np.float32),
            keypoints_px=np.array(data["keypoints_px"], np.float32),
            diameter_m=float(data["diameter_m"]),
            cut_height_m=float(data["cut_height_m"]),
            distance_m=float(data["distance_m"]),
            inclination_deg=float(data["inclination_deg"]),
            visible_fraction=float(data["visible_fraction"]),
            species=str(data["species"]),
        )


@dataclass(frozen=True, eq=False)
class SampleFrame:
    """One sample frame; its images are read when asked for.

    Attributes:
        name: for example "sample_0".
        image_path: the colour image.
        depth_path: the depth image, 16-bit millimetres.
        camera: what took both.
        up_camera: (3,) unit vector that points up, in the camera's frame, as an IMU gives it.
        trees: the truth.
    """

    name: str
    image_path: Path
    depth_path: Path
    camera: PinholeCamera
    up_camera: NDArray[np.float64]
    trees: tuple[SampleTree, ...]

    def image(self) -> NDArray[np.uint8]:
        """The colour image, (H, W, 3) uint8 BGR."""
        return read_image(self.image_path)

    def depth_m(self) -> NDArray[np.float32]:
        """The depth image, (H, W) float32 metres, 0.0 = no reading."""
        return read_depth(self.depth_path)


def sample_frames() -> list[SampleFrame]:
    """The frames that come with this package, by name."""
    folder = Path(__file__).parent / "assets" / "samples"
    return [_read_sample(path) for path in sorted(folder.glob("sample_*.json"))]


def _read_sample(path: Path) -> SampleFrame:
    data = json.loads(path.read_text(encoding="utf-8"))
    return SampleFrame(
        name=path.stem,
        image_path=path.with_suffix(".jpg"),
        depth_path=path.with_name(f"{path.stem}_depth_mm.png"),
        camera=PinholeCamera.from_dict(data["camera"]),
        up_camera=np.array(data["up_camera"], dtype=np.float64),
        trees=tuple(SampleTree.from_dict(tree) for tree in data["trees"]),
    )
