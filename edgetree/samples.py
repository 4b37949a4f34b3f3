"""The sample frames in the package: image, depth, camera and ground truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, read_depth
from edgetree.frames.frame import Frame
from edgetree.frames.images import read_image


@dataclass(frozen=True, eq=False)
class SampleTree:
    """Ground truth of one simulated tree.

    Attributes:
        box_px: (4,) float32 x0, y0, x1, y1 around the visible lower stem.
        keypoints_px: (5, 3) float32 x, y, flag in the order of `KEYPOINT_NAMES`. The flag is 2
            for visible, 1 for hidden and 0 for outside the frame, where x and y are 0.
        diameter_m: Stem diameter at the height of the diameter keypoints.
        cut_height_m: Height of the felling cut above the ground on the uphill side.
        distance_m: Distance from the camera's centre to the stem's axis at the cut.
        inclination_deg: Angle between the stem's axis and the vertical.
        visible_fraction: Visible part of the lower stem, 0 to 1.
        species: Name of the species.
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
        """Make a tree from its JSON object."""
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
    """One sample frame. Its images are read by `image` and `depth_m`.

    Attributes:
        name: For example "sample_0".
        image_path: File of the colour image.
        depth_path: File of the depth image, 16-bit millimetres.
        camera: The camera of both images.
        up_camera: (3,) unit vector opposite to gravity in the camera's frame, as from an IMU.
        trees: Ground truth of the labelled trees.
    """

    name: str
    image_path: Path
    depth_path: Path
    camera: PinholeCamera
    up_camera: NDArray[np.float64]
    trees: tuple[SampleTree, ...]

    def image(self) -> NDArray[np.uint8]:
        """Read the colour image, (H, W, 3) uint8 BGR."""
        return read_image(self.image_path)

    def depth_m(self) -> NDArray[np.float32]:
        """Read the depth image, (H, W) float32 metres, 0.0 = no reading."""
        return read_depth(self.depth_path)

    def read(self) -> Frame:
        """Read both images, as a frame of the kind that `edgetree.sources.open_source` gives."""
        return Frame(self.name, self.image_path, self.image(), self.depth_m())


def sample_frames() -> list[SampleFrame]:
    """The sample frames in the package, sorted by name.

    Examples:
        >>> from edgetree import sample_frames
        >>> frame = sample_frames()[0]
        >>> (frame.name, frame.image().shape, frame.depth_m().shape)
        ('sample_0', (720, 1280, 3), (720, 1280))
    """
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
