"""A ROS 2 node: colour, depth and camera in, the stems of each frame out as JSON.

    python examples/ros2_node.py

Subscribes to /camera/color/image_raw, /camera/aligned_depth_to_color/image_raw (16UC1, mm) and
/camera/color/camera_info, and publishes std_msgs/String on /edgetree/stems: an object of the schema
edgetree.live/1 for each frame. Needs rclpy, message_filters, sensor_msgs and std_msgs of ROS 2.
"""

from __future__ import annotations

import json
import threading
from typing import Any

import numpy as np
import rclpy
from message_filters import ApproximateTimeSynchronizer, Subscriber
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String

from calib import PinholeCamera
from edgetree import TreeDetector, default_model
from edgetree.live import LivePipeline
from edgetree.results import live_record
from edgetree.sources import PushedFrames, frame_from_arrays

LARGEST_DIFFERENCE_S = 0.02
COLOUR_ORDER = {"bgr8": "bgr", "rgb8": "rgb"}


class StemNode(Node):
    """Hands frames to the pipeline and publishes its results."""

    def __init__(self) -> None:
        super().__init__("edgetree")
        self.source = PushedFrames("ROS topics")
        self._number = 0
        self._publisher = self.create_publisher(String, "/edgetree/stems", 1)
        topics = {
            "/camera/color/image_raw": Image,
            "/camera/aligned_depth_to_color/image_raw": Image,
            "/camera/color/camera_info": CameraInfo,
        }
        subscribers = [Subscriber(self, kind, topic) for topic, kind in topics.items()]
        self._synchroniser = ApproximateTimeSynchronizer(subscribers, 5, LARGEST_DIFFERENCE_S)
        self._synchroniser.registerCallback(self._take)

    def _take(self, colour: Any, depth: Any, info: Any) -> None:
        stamp = colour.header.stamp
        frame = frame_from_arrays(
            self._number,
            stamp.sec + stamp.nanosec * 1e-9,
            _pixels(colour, np.uint8, 3),
            _pixels(depth, np.uint16, 1)[..., 0],
            depth_scale_m=0.001,
            colour_order=COLOUR_ORDER[colour.encoding],
            camera=_camera(info),
        )
        self._number += 1
        self.source.push(frame)

    def publish(self, detector: TreeDetector) -> None:
        """Publish the result of each frame until the source is closed."""
        for result in LivePipeline(lambda: self.source, detector):
            self._publisher.publish(String(data=json.dumps(live_record(result))))


def _pixels(message: Any, dtype: Any, channels: int) -> Any:
    """The pixels of an image message, (H, W, channels); rows may be padded."""
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    values = np.ascontiguousarray(rows[:, : message.width * channels * np.dtype(dtype).itemsize])
    return values.view(dtype).reshape(message.height, message.width, channels)


def _camera(info: Any) -> PinholeCamera:
    """The camera of a CameraInfo. ROS puts (0, 0) in the centre of a pixel, as edgetree does."""
    fx, _, cx, _, fy, cy = info.k[:6]
    return PinholeCamera(info.width, info.height, fx, fy, cx, cy, distortion=tuple(info.d))


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    node = StemNode()
    detector = TreeDetector.load(default_model("depth"), warm_up=True)
    worker = threading.Thread(target=node.publish, args=(detector,))
    worker.start()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.source.close()
        worker.join()


if __name__ == "__main__":
    main()
