"""The topics of pictures in a recording, and the topics of their cameras."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Final

from edgetree.sources.bags.camera_info import may_fit, same_lens
from edgetree.sources.bags.encodings import depth_names
from edgetree.sources.bags.exact import FILLED_TOPIC
from edgetree.sources.bags.messages import (
    IMAGE_TYPES,
    PictureKind,
    frame_of,
    kind_of_picture,
    without_transport,
)
from edgetree.sources.bags.reader import Bag, Topic
from edgetree.sources.bags.topic_words import depth_by_name

_log = logging.getLogger(__name__)

CAMERA_TYPE: Final = "sensor_msgs/msg/CameraInfo"

# Types of messages whose names end so hold pictures.
_PICTURE_LIKE: Final = ("Image", "Packet", "Video")
_MAX_LISTED: Final = 8


@dataclass(frozen=True)
class ImageTopic:
    """A topic of pictures, as its first message shows it.

    Attributes:
        name: Its name.
        kind: What it carries.
        frame: The frame of its pictures.
        size: Their width and height in px; None of compressed ones.
    """

    name: str
    kind: PictureKind
    frame: str
    size: tuple[int, int] | None

    @property
    def base(self) -> str:
        """The name without its transport."""
        return without_transport(self.name)


def find_image_topics(bag: Bag) -> list[ImageTopic]:
    """The topics of pictures; warns of those whose first message is not there."""
    pictures = []
    for name, topic in bag.topics.items():
        if topic.message_type not in IMAGE_TYPES or name == FILLED_TOPIC:
            continue
        message = bag.first(name)
        if message is None:
            reason = "is empty" if topic.count == 0 else "cannot be decoded"
            _log.warning("recording %s: topic %s (%s) %s", bag.path, name, stored(topic), reason)
            continue
        size = (int(message.width), int(message.height)) if hasattr(message, "step") else None
        picture = ImageTopic(name, kind_of_picture(message, name), frame_of(message), size)
        info = camera_topic(bag, picture) if picture.kind.role == "other" else None
        camera = bag.first(info) if info is not None else None
        frames = [picture.frame, *([] if camera is None else [frame_of(camera)])]
        pictures.append(replace(picture, kind=kind_of_picture(message, name, frames)))
    return pictures


def stored(topic: Topic) -> str:
    """The type of a topic as it is stored, with its encoding if that is not ROS's own."""
    channel = topic.channels[0]
    own = channel.encoding in ("cdr", "ros1")
    return channel.message_type if own else f"{channel.message_type} in {channel.encoding}"


def warn_of_left_out(
    bag: Bag, pictures: list[ImageTopic], lacking: list[str], colour: str | None
) -> None:
    """Name the topics of pictures that are not read.

    Args:
        bag: The recording.
        pictures: Its topics of pictures.
        lacking: The roles for which no topic was found; if empty, nothing is said.
        colour: The topic that is read as colour.
    """
    if not lacking:
        return
    left = [
        f"{each.name} ({each.kind.encoding}) is left out: {each.kind.reason}"
        for each in pictures
        if each.kind.role == "other"
    ]
    left += [
        f"{name} is left out: it is of {topic.message_type}, expected {', '.join(IMAGE_TYPES)}"
        for name, topic in bag.topics.items()
        if topic.message_type.endswith(_PICTURE_LIKE) and topic.message_type not in IMAGE_TYPES
    ]
    if "depth" in lacking:
        left += [
            f"{each.name} ({each.kind.encoding}) is left out: it has 8 bits, expected"
            f" {depth_names()}"
            for each in pictures
            if each.kind.role == "grey" and each.name != colour
            if depth_by_name([each.base])[0] == "depth"
        ]
    absent = " and no ".join(lacking)
    for line in left:
        _log.warning("recording %s has no %s; topic %s", bag.path, absent, line)


def camera_topic(bag: Bag, picture: ImageTopic | None) -> str | None:
    """The CameraInfo topic of an image topic: of the same namespace, or else of the same frame."""
    if picture is None:
        return None
    infos = [
        name
        for name, topic in bag.topics.items()
        if topic.message_type == CAMERA_TYPE and topic.count
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
        if frame_of(message) == picture.frame and may_fit(message, picture.size)
    ]
    of_depth = [name for name in same if depth_by_name([name])[0] == "depth"]
    others = [name for name in same if name not in of_depth]
    same = (of_depth if picture.kind.role == "depth" else others) or same
    if any(not same_lens(firsts[same[0]], firsts[name]) for name in same[1:]):
        _log.warning(
            "recording %s: %s state different lenses for frame %r, so none is used for %s: expected"
            " one of them to be named as topic 'camera' or 'depth_camera'",
            bag.path,
            listed(same),
            picture.frame,
            picture.name,
        )
        return None
    return same[0] if same else None


def listed(names: list[str]) -> str:
    """The first names, and how many more there are."""
    more = len(names) - _MAX_LISTED
    return ", ".join(names[:_MAX_LISTED]) + (f" and {more} more" if more > 0 else "")
