"""Live results as standard messages of ROS 2, for bags and for a node."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from edgetree.drawing.trees import tree_colour
from edgetree.frames.frame import level_axes
from edgetree.measure import Estimate
from edgetree.results.json_records import live_record
from edgetree.sinks.ros_types import MakeMessage, RosTypes

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.live.tracking.tracks import TreeTrack

CAMERA_FRAME, MAP_FRAME = "edgetree_camera", "edgetree_map"
TOPICS: Final = {
    "/edgetree/image/compressed": "sensor_msgs/msg/CompressedImage",
    "/edgetree/camera_info": "sensor_msgs/msg/CameraInfo",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/edgetree/detections": "vision_msgs/msg/Detection3DArray",
    "/edgetree/markers": "visualization_msgs/msg/MarkerArray",
    "/edgetree/json": "std_msgs/msg/String",
}
"""The topics and their types."""

# vision_msgs is not among the types of rosbags.
_VISION: Final = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id",
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
}
_QUALITY: Final = 85
_HEIGHT_M: Final = 1.3  # of the cylinder that stands for a stem
_DEFAULT_DIAMETER_M: Final = 0.1
_CYLINDER, _TEXT, _ADD, _DELETE_ALL = 3, 9, 0, 3


class _Place(NamedTuple):
    """What all messages of one result share."""

    header: Any
    up: NDArray[np.float64]
    orientation: Any


class RosMessages(RosTypes):
    """Makes the messages.

    Positions are in the camera's frame (x right, y down, z forward). `/tf` says where it is in
    `edgetree_map`, if the source knows the pose.

    Args:
        make: Makes one message, as for `RosTypes`.

    Attributes:
        camera_frame: Name of the camera's frame.
    """

    def __init__(self, make: MakeMessage | None = None) -> None:
        super().__init__(make)
        self.camera_frame = CAMERA_FRAME
        if make is None:
            from rosbags.typesys import get_types_from_msg

            for name, text in _VISION.items():
                self.store.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))

    def all(self, result: LiveResult) -> Iterator[tuple[str, Any]]:
        """Topic and message of all that is known of a result."""
        header = self.header(result.frame.stamp_s, self.camera_frame)
        image, camera = result.frame.image, result.frame.camera
        if image is not None:
            jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
            yield (
                "/edgetree/image/compressed",
                self.new("sensor_msgs", "CompressedImage", header, "jpeg", jpeg.reshape(-1)),
            )
        if camera is not None:
            yield "/edgetree/camera_info", self.camera_info(header, camera)
        if result.frame.pose is not None:
            yield "/tf", self._transform(result)
        yield from self.stems(result)

    def stems(self, result: LiveResult) -> Iterator[tuple[str, Any]]:
        """Topic and message of the stems alone: detections, markers and the record as JSON."""
        axes = level_axes(result.vertical)
        header = self.header(result.frame.stamp_s, self.camera_frame)
        place = _Place(header, axes[2], self.quaternion(axes.T))
        yield "/edgetree/detections", self._detections(result, place)
        yield "/edgetree/markers", self._markers(result, place)
        yield "/edgetree/json", self.new("std_msgs", "String", json.dumps(live_record(result)))

    def _transform(self, result: LiveResult) -> Any:
        pose = result.frame.pose
        assert pose is not None
        header = self.header(result.frame.stamp_s, MAP_FRAME)
        return self.new("tf2_msgs", "TFMessage", [self.transform(header, self.camera_frame, pose)])

    def _detections(self, result: LiveResult, place: _Place) -> Any:
        """The stems in view."""
        found = [
            self._detection(result, track, float(result.trees.scores[track.tree]), place)
            for track in result.tracks
            if track.tree is not None
        ]
        return self.new("vision_msgs", "Detection3DArray", place.header, found)

    def _detection(self, result: LiveResult, track: TreeTrack, score: float, place: _Place) -> Any:
        pose = self.new(
            "geometry_msgs", "Pose", self.vector(track.position_camera_m), place.orientation
        )
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = _covariance(result, track)
        with_covariance = self.new(
            "geometry_msgs", "PoseWithCovariance", pose, covariance.reshape(-1)
        )
        hypothesis = self.new("vision_msgs", "ObjectHypothesis", "tree", score)
        box = self.new(
            "vision_msgs",
            "BoundingBox3D",
            self._centre(track, place),
            self.vector(_size(track), "Vector3"),
        )
        results = [self.new("vision_msgs", "ObjectHypothesisWithPose", hypothesis, with_covariance)]
        number = str(track.number)
        return self.new("vision_msgs", "Detection3D", place.header, results, box, number)

    def _centre(self, track: TreeTrack, place: _Place) -> Any:
        centre = track.position_camera_m + _HEIGHT_M / 2 * place.up
        return self.new("geometry_msgs", "Pose", self.vector(centre), place.orientation)

    def _markers(self, result: LiveResult, place: _Place) -> Any:
        """A cylinder and a text for each stem, in view or not; older ones are removed."""
        markers = [self._marker(place, 0, _DELETE_ALL)]
        for track in result.tracks:
            blue, green, red = (value / 255 for value in tree_colour(track.number))
            alpha = 0.9 if track.tree is not None else 0.35
            colour = self.new("std_msgs", "ColorRGBA", red, green, blue, alpha)
            cylinder = self._marker(place, 2 * track.number, _ADD, _CYLINDER, colour)
            cylinder.pose = self._centre(track, place)
            cylinder.scale = self.vector(_size(track), "Vector3")
            white = self.new("std_msgs", "ColorRGBA", 1.0, 1.0, 1.0, 1.0)
            text = self._marker(place, 2 * track.number + 1, _ADD, _TEXT, white)
            top = track.position_camera_m + (_HEIGHT_M + 0.15) * place.up
            text.pose = self.new("geometry_msgs", "Pose", self.vector(top), place.orientation)
            text.scale.z, text.text = 0.2, _words(track)
            markers += [cylinder, text]
        return self.new("visualization_msgs", "MarkerArray", markers)

    def _marker(
        self, place: _Place, number: int, action: int, kind: int = 0, colour: Any = None
    ) -> Any:
        zero = self.new("builtin_interfaces", "Duration", 0, 0)
        no_time = self.new("builtin_interfaces", "Time", 0, 0)
        empty = self.new("std_msgs", "Header", no_time, "")
        nothing = np.zeros(0, np.uint8)
        pose = self.new("geometry_msgs", "Pose", self.vector(np.zeros(3)), place.orientation)
        scale = self.vector(np.zeros(3), "Vector3")
        colour = colour or self.new("std_msgs", "ColorRGBA", 0.0, 0.0, 0.0, 0.0)
        texture = self.new("sensor_msgs", "CompressedImage", empty, "", nothing)
        mesh = self.new("visualization_msgs", "MeshFile", "", nothing)
        head = (place.header, "stems", number, kind, action, pose, scale, colour, zero, False)
        return self.new(
            "visualization_msgs", "Marker", *head, [], [], "", texture, [], "", "", mesh, False
        )


def _covariance(result: LiveResult, track: TreeTrack) -> NDArray[np.float64]:
    """Covariance of the position in the camera's frame.

    Without a pose, the map's directions are not known in it: then the largest variance is taken for
    all directions.
    """
    variances = np.asarray(track.position_m.std_m, np.float64) ** 2
    if result.frame.pose is None:
        return np.eye(3) * float(variances.max())
    rotation = result.frame.pose.rotation
    return np.asarray(rotation.T @ np.diag(variances) @ rotation, np.float64)


def _size(track: TreeTrack) -> NDArray[np.float64]:
    diameter = track.diameter_m
    width_m = diameter.value if isinstance(diameter, Estimate) else _DEFAULT_DIAMETER_M
    return np.array([width_m, width_m, _HEIGHT_M])


def _words(track: TreeTrack) -> str:
    diameter = track.diameter_m
    if not isinstance(diameter, Estimate):
        return f"{track.number}"
    return f"{track.number}: {diameter.value * 100:.1f} ± {diameter.std * 100:.1f} cm"
