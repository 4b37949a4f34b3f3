"""Choose the topics of a recording: colour, depth, their cameras, IMU and transforms."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from basetree.errors import InputError
from edgetree.sources.bags.exact import EXACT_TOPIC, EXACT_TYPE
from edgetree.sources.bags.messages import IMAGE_TYPES, PictureKind, kind_of_picture
from edgetree.sources.bags.reader import TF_TYPE, Bag
from edgetree.sources.bags.transforms import frame_name

_log = logging.getLogger(__name__)

Modality = Literal["both", "rgb", "depth"]
ROLES: Final = ("colour", "depth", "camera", "depth_camera", "imu")

_CAMERA_TYPE: Final = "sensor_msgs/msg/CameraInfo"
_IMU_TYPE: Final = "sensor_msgs/msg/Imu"
_TF_TYPES: Final = (TF_TYPE, "tf/msg/tfMessage")
_TRANSPORTS: Final = ("/compressed", "/compressedDepth")
_MAX_LISTED: Final = 8


@dataclass(frozen=True)
class Streams:
    """The names of the topics that are read. None means that there is no such topic.

    Attributes:
        colour: Colour images.
        depth: Depth images.
        camera: CameraInfo of the colour images.
        depth_camera: CameraInfo of the depth images.
        imu: IMU with an accelerometer.
        transforms: Topics of transforms.
        exact: Cameras and verticals to the last digit, of edgetree's own recordings.
    """

    colour: str | None
    depth: str | None
    camera: str | None
    depth_camera: str | None
    imu: str | None
    transforms: tuple[str, ...]
    exact: str | None = None

    @property
    def names(self) -> list[str]:
        """All names, each once."""
        named = (self.colour, self.depth, self.camera, self.depth_camera, self.imu, self.exact)
        return list(
            dict.fromkeys([name for name in named if name is not None])
            | dict.fromkeys(self.transforms)
        )


@dataclass(frozen=True)
class _Picture:
    """An image topic and its first message."""

    name: str
    kind: PictureKind
    frame: str
    size: tuple[int, int] | None

    @property
    def base(self) -> str:
        """The name without its transport."""
        return _base(self.name)


def choose_streams(bag: Bag, topics: Mapping[str, str], modality: Modality) -> Streams:
    """Choose topics by their types, encodings and frames.

    Args:
        bag: The recording.
        topics: Names of topics by role, one of `ROLES`. The others are found.
        modality: "both" for all there is, "rgb" for colour alone, "depth" for depth alone.

    Raises:
        InputError: a named topic is missing or of another type, there are no images of the
            modality, or it is not clear which topic is meant.
    """
    unknown = sorted(set(topics) - set(ROLES))
    if unknown:
        raise InputError(f"topics names {', '.join(unknown)}: expected {', '.join(ROLES)}")
    given = {role: _given(bag, role, name) for role, name in topics.items()}
    pictures = _pictures(bag)
    colour = depth = None
    if modality != "depth":
        colour = given.get("colour") or _one(bag.path, "colour", pictures, given.get("depth"))
    if modality != "rgb":
        depth = given.get("depth") or _one(bag.path, "depth", pictures, colour)
    missing = {"rgb": colour is None, "depth": depth is None}.get(modality, not (colour or depth))
    if missing:
        raise InputError(_no_images(bag, pictures, modality))
    by_name = {picture.name: picture for picture in pictures}
    return Streams(
        colour,
        depth,
        given.get("camera") or _camera_for(bag, by_name.get(colour or "")),
        given.get("depth_camera") or _camera_for(bag, by_name.get(depth or "")),
        given.get("imu") or _imu(bag),
        tuple(name for name, topic in bag.topics.items() if topic.message_type in _TF_TYPES),
        EXACT_TOPIC if _has_exact(bag) else None,
    )


def _has_exact(bag: Bag) -> bool:
    topic = bag.topics.get(EXACT_TOPIC)
    return topic is not None and topic.message_type == EXACT_TYPE


def _given(bag: Bag, role: str, name: str) -> str:
    """A named topic, checked; images may be named without their transport."""
    types = {"imu": (_IMU_TYPE,), "colour": IMAGE_TYPES, "depth": IMAGE_TYPES}
    expected = types.get(role, (_CAMERA_TYPE,))
    fitting = [key for key, topic in bag.topics.items() if topic.message_type in expected]
    for candidate in (name, *(f"{name}{transport}" for transport in _TRANSPORTS)):
        if candidate in fitting:
            if bag.topics[candidate].count == 0:
                raise InputError(f"recording {bag.path}: topic {candidate} is empty")
            return candidate
    found = f"is of {bag.topics[name].message_type}" if name in bag.topics else "does not exist"
    raise InputError(
        f"recording {bag.path}: topic {name} for {role} {found}: expected"
        f" {_listed(fitting) or f'a topic of {expected[0]}, and there is none'}"
    )


def _pictures(bag: Bag) -> list[_Picture]:
    pictures = []
    for name, topic in bag.topics.items():
        if topic.message_type not in IMAGE_TYPES:
            continue
        message = bag.first(name)
        if message is None:
            reason = "is empty" if topic.count == 0 else "cannot be decoded"
            _log.warning("recording %s: topic %s %s", bag.path, name, reason)
            continue
        size = (int(message.width), int(message.height)) if hasattr(message, "width") else None
        kind = kind_of_picture(message, name)
        pictures.append(_Picture(name, kind, frame_name(message.header.frame_id), size))
    return pictures


def _one(path: Path, role: str, pictures: list[_Picture], other: str | None) -> str | None:
    """The only topic of a role; None if there is none.

    Raw images are preferred to compressed ones of the same name, and topics in the frame of the
    other role's topic to those in other frames.
    """
    found = [picture for picture in pictures if picture.kind.role == role]
    if role == "colour" and not found:
        found = [picture for picture in pictures if picture.kind.role == "grey"]
    raw = {picture.name for picture in found if picture.name == picture.base}
    found = [picture for picture in found if picture.name in raw or picture.base not in raw]
    if len(found) > 1:
        others = [p for p in pictures if p.name == other]
        if other is None:
            others = [p for p in pictures if p.kind.role in {"colour", "depth"} - {role}]
        frames = {picture.frame for picture in others}
        same = [picture for picture in found if len(frames) == 1 and picture.frame in frames]
        found = same if len(same) == 1 else found
    if len(found) > 1:
        raise InputError(
            f"recording {path} has {len(found)} topics of {role} images: expected one of them to"
            f" be named as topic {role!r}: {_listed([picture.name for picture in found])}"
        )
    return found[0].name if found else None


def _camera_for(bag: Bag, picture: _Picture | None) -> str | None:
    """The CameraInfo topic of an image topic: of the same namespace, or else of the same frame."""
    if picture is None:
        return None
    infos = [
        name
        for name, topic in bag.topics.items()
        if topic.message_type == _CAMERA_TYPE and topic.count
    ]
    for name in (
        f"{picture.base.rpartition('/')[0]}/camera_info",
        f"{picture.base.removesuffix('/image/data')}/info/camera_info",  # of RealSense's viewer
    ):
        if name in infos:
            return name
    firsts = {name: message for name in infos if (message := bag.first(name)) is not None}
    same = [
        name
        for name, message in firsts.items()
        if frame_name(message.header.frame_id) == picture.frame
        and picture.size in (None, (message.width, message.height))
    ]
    return same[0] if same else None


def _imu(bag: Bag) -> str | None:
    """The only topic with accelerations; None if there is none, or several."""
    found = [
        name
        for name, topic in bag.topics.items()
        if topic.message_type == _IMU_TYPE and _accelerates(bag.first(name))
    ]
    if len(found) > 1:
        _log.warning(
            "recording %s has %d IMU topics, none is used: expected one of them to be named as"
            " topic 'imu': %s",
            bag.path,
            len(found),
            _listed(found),
        )
    return found[0] if len(found) == 1 else None


def _accelerates(message: Any | None) -> bool:
    if message is None:
        return False
    acceleration = message.linear_acceleration
    return any((acceleration.x, acceleration.y, acceleration.z))


def _no_images(bag: Bag, pictures: list[_Picture], modality: Modality) -> str:
    wanted = {"both": "images", "rgb": "colour images", "depth": "depth images"}[modality]
    found = [f"{picture.name} ({picture.kind.encoding})" for picture in pictures]
    found = found or [f"{name} ({topic.message_type})" for name, topic in bag.topics.items()]
    return (
        f"recording {bag.path} has no {wanted}: expected a topic of sensor_msgs/Image or"
        f" CompressedImage; it has {_listed(found) or 'no topics'}"
    )


def _base(name: str) -> str:
    for transport in _TRANSPORTS:
        if name.endswith(transport):
            return name.removesuffix(transport)
    return name


def _listed(names: list[str]) -> str:
    more = len(names) - _MAX_LISTED
    return ", ".join(names[:_MAX_LISTED]) + (f" and {more} more" if more > 0 else "")
