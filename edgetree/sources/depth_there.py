"""Whether a source has depth, which decides on the model that sees it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calib.clouds import is_cloud_file
from edgetree.catalogue import suited_model
from edgetree.sources.bags.names import is_bag
from edgetree.sources.drive import is_drive
from edgetree.sources.folders import depth_alone, depth_inside, has_images
from edgetree.sources.live import VENDORS, is_camera
from edgetree.sources.phones.opening import is_capture
from edgetree.sources.stereo import RIGHT_TOPIC


def model_for(
    source: Path | str, *depth: Path | None, topics: Mapping[str, str] | None = None
) -> str:
    """Name of the packaged model that suits a source: for depth where it has depth, else colour.

    Args:
        source: A source as for `edgetree run` or `edgetree live`.
        depth: What is given beside it that tells depth: images, clouds, the pictures of a right
            camera.
        topics: Names of topics by role, for recordings.

    Raises:
        InputError: It is a recording that cannot be opened.

    Examples:
        >>> from edgetree.sources import model_for
        >>> model_for("walk.mp4")
        'edge-s-rgb'
        >>> model_for("realsense")
        'edge-n-depth'
    """
    return suited_model(with_depth=has_depth(source, *depth, topics=topics))


def has_depth(
    source: Path | str, *depth: Path | None, topics: Mapping[str, str] | None = None
) -> bool:
    """Whether the frames of a source have depth, as far as is known before they are read.

    Args:
        source: As for `model_for`, and so are the others.
        depth: Paths.
        topics: Names by role.

    Raises:
        InputError: It is a recording that cannot be opened.
    """
    if any(path is not None for path in depth):
        return True
    if is_camera(str(source)):
        return str(source).strip() in VENDORS
    path = Path(source)
    if not path.exists():
        return False
    if is_drive(path) or is_capture(path) or is_cloud_file(path):
        return True
    if is_bag(path) and not has_images(path):
        named = {"depth", RIGHT_TOPIC} & set(topics or {})
        return bool(named) or _has_depth_topic(path)
    return (depth_alone(path) or depth_inside(path)) is not None


def _has_depth_topic(path: Path) -> bool:
    from edgetree.sources.bags.image_topics import find_image_topics
    from edgetree.sources.bags.reader import Bag

    with Bag(path) as bag:
        return any(picture.kind.role == "depth" for picture in find_image_topics(bag))
