"""Types of what other packages' JSON holds of cameras and labels. Units are in the names."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from basetree.schemas import Count, Side, Sides

Above0 = Annotated[float, Meta(gt=0)]
Deviation = Annotated[float, Meta(ge=0)]
Box = Annotated[list[float], Meta(min_length=4, max_length=4, description="x, y, wide, high in px")]


class Camera(TypedDict):
    """Intrinsics in OpenCV's convention."""

    width: Side
    height: Side
    fx: Above0
    fy: Above0
    cx: float
    cy: float
    distortion: NotRequired[list[float]]
    distortion_model: NotRequired[Literal["radtan", "fisheye"]]
    focal_std_px: NotRequired[Deviation]
    principal_std_px: NotRequired[Deviation]


class RunLengths(TypedDict):
    """COCO's compressed run lengths."""

    size: Sides
    counts: str


class CocoImage(TypedDict):
    """A picture."""

    id: int
    file_name: str
    width: Side
    height: Side


class CocoObject(TypedDict):
    """An object that was found. Keypoints are pixel indices and flags, three numbers for each."""

    id: int
    image_id: int
    category_id: int
    bbox: Box
    area: float
    iscrowd: int
    score: float
    segmentation: RunLengths | list[list[float]]
    keypoints: NotRequired[list[float]]
    num_keypoints: NotRequired[Count]


class CocoCategory(TypedDict):
    """A kind of object."""

    id: int
    name: str
    supercategory: NotRequired[str]
    keypoints: NotRequired[list[str]]
    skeleton: NotRequired[list[list[int]]]


class FoundLabels(TypedDict):
    """COCO file of what was found: `edgetree run --coco`, `perceptree predict`; no key `schema`."""

    info: dict[str, Any]
    licenses: list[Any]
    images: list[CocoImage]
    annotations: list[CocoObject]
    categories: list[CocoCategory]
