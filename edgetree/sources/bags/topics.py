"""Choose the topics of a recording: colour, depth, their cameras, IMU and transforms."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from basetree.errors import InputError
from edgetree.sources.bags.exact import EXACT_TOPIC, EXACT_TYPE, FILLED_TOPIC, FILLED_TYPE
from edgetree.sources.bags.image_topics import (
    CAMERA_TYPE,
    ImageTopic,
    camera_topic,
    find_image_topics,
    listed,
    stored,
    warn_of_left_out,
)
from edgetree.sources.bags.messages import IMAGE_TYPES, TRANSPORTS
from edgetree.sources.bags.point_clouds import CLOUD_TYPE
from edgetree.sources.bags.reader import TF_TYPE, Bag

_log = logging.getLogger(__name__)

Modality = Literal["both", "rgb", "depth"]
ROLES: Final = ("colour", "depth", "camera", "depth_camera", "imu")

_IMU_TYPE: Final = "sensor_msgs/msg/Imu"
_TF_TYPES: Final = (TF_TYPE, "tf/msg/tfMessage")


@dataclass(frozen=True)
class Streams:
    """The names of the topics that are read. None means that there is no such topic.

    Attributes:
        colour: Colour images.
        depth: Depth images, or the point clouds of a scanner.
        camera: CameraInfo of the colour images.
        depth_camera: CameraInfo of the depth images.
        imu: IMU with an accelerometer.
        transforms: Topics of transforms.
        exact: Cameras and verticals to the last digit, of edgetree's own recordings.
        has_clouds: Whether `depth` is a topic of point clouds.
        filled: Depth of beams without the gaps between them, of edgetree's own recordings.
    """

    colour: str | None
    depth: str | None
    camera: str | None
    depth_camera: str | None
    imu: str | None
    transforms: tuple[str, ...]
    exact: str | None = None
    has_clouds: bool = False
    filled: str | None = None

    @property
    def names(self) -> list[str]:
        """All names, each once."""
        named = [self.colour, self.depth, self.camera, self.depth_camera, self.imu, self.exact]
        named.append(self.filled)
        return list(
            dict.fromkeys([name for name in named if name is not None])
            | dict.fromkeys(self.transforms)
        )


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
    pictures = find_image_topics(bag)
    colour = depth = None
    if modality != "depth":
        colour = given.get("colour") or _one(bag.path, "colour", pictures, given.get("depth"))
    if modality != "rgb":
        depth = given.get("depth") or _one(bag.path, "depth", pictures, colour)
    missing = {"rgb": colour is None, "depth": depth is None}.get(modality, not (colour or depth))
    if missing:
        raise InputError(_no_images(bag, pictures, modality))
    wanted = {"rgb": ("colour",), "depth": ("depth",)}.get(modality, ("colour", "depth"))
    chosen = {"colour": colour, "depth": depth}
    lacking = [role for role in wanted if chosen[role] is None]
    warn_of_left_out(bag, pictures, lacking, colour)
    by_name = {picture.name: picture for picture in pictures}
    # A camera that is named for depth without any colour beside it can be of the depth alone.
    has_colour = any(picture.kind.role in ("colour", "grey") for picture in pictures)
    of_depth = None if has_colour or depth is None else given.pop("camera", None)
    return Streams(
        colour,
        depth,
        given.get("camera") or camera_topic(bag, by_name.get(colour or "")),
        given.get("depth_camera") or of_depth or camera_topic(bag, by_name.get(depth or "")),
        given.get("imu") or _imu(bag),
        tuple(name for name, topic in bag.topics.items() if topic.message_type in _TF_TYPES),
        EXACT_TOPIC if _has(bag, EXACT_TOPIC, EXACT_TYPE) else None,
        depth is not None and bag.topics[depth].message_type == CLOUD_TYPE,
        FILLED_TOPIC if modality != "rgb" and _has(bag, FILLED_TOPIC, FILLED_TYPE) else None,
    )


def _has(bag: Bag, name: str, message_type: str) -> bool:
    topic = bag.topics.get(name)
    return topic is not None and topic.message_type == message_type


def _given(bag: Bag, role: str, name: str) -> str:
    """A named topic, checked; images may be named without their transport."""
    types = {
        "imu": (_IMU_TYPE,),
        "colour": IMAGE_TYPES,
        "depth": (*IMAGE_TYPES, CLOUD_TYPE),
    }
    expected = types.get(role, (CAMERA_TYPE,))
    fitting = [key for key, topic in bag.topics.items() if topic.message_type in expected]
    for candidate in (name, *(f"{name}{transport}" for transport in TRANSPORTS)):
        if candidate in fitting:
            if bag.topics[candidate].count == 0:
                raise InputError(f"recording {bag.path}: topic {candidate} is empty")
            return candidate
    found = f"is of {bag.topics[name].message_type}" if name in bag.topics else "does not exist"
    raise InputError(
        f"recording {bag.path}: topic {name} for {role} {found}: expected"
        f" {listed(fitting) or f'a topic of {expected[0]}, and there is none'}"
    )


def _one(path: Path, role: str, pictures: list[ImageTopic], other: str | None) -> str | None:
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
            f" be named as topic {role!r}: {listed([picture.name for picture in found])}"
        )
    return found[0].name if found else None


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
            listed(found),
        )
    return found[0] if len(found) == 1 else None


def _accelerates(message: Any | None) -> bool:
    if message is None:
        return False
    acceleration = message.linear_acceleration
    return any((acceleration.x, acceleration.y, acceleration.z))


def _no_images(bag: Bag, pictures: list[ImageTopic], modality: Modality) -> str:
    if bag.is_cut_off and not bag.topics:
        return (
            f"recording {bag.path} cannot be read: its end is missing, and no part before it is"
            " complete"
        )
    wanted = {"both": "images", "rgb": "colour images", "depth": "depth images"}[modality]
    found = [f"{each.name} ({each.kind.encoding}){_reason(each)}" for each in pictures]
    found = found or [f"{name} ({stored(topic)})" for name, topic in bag.topics.items()]
    return (
        f"recording {bag.path} has no {wanted}: expected a topic of sensor_msgs/Image or"
        f" CompressedImage; it has {listed(found) or 'no topics'}"
    )


def _reason(picture: ImageTopic) -> str:
    return f", left out as {picture.kind.reason}" if picture.kind.reason else ""
