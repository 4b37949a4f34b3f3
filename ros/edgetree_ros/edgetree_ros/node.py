"""The node: pictures and their cameras in, the stems of each frame out."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from message_filters import ApproximateTimeSynchronizer, Subscriber
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import MarkerArray

from basetree.errors import EdgetreeError
from edgetree.live import LivePipeline
from edgetree.live.results import LiveResult
from edgetree.sinks.ros_diagnostics import RosDiagnostics
from edgetree.sinks.ros_messages import RosMessages
from edgetree.sources import PushedFrames, TopicFrames
from edgetree_ros.message_classes import new_message
from edgetree_ros.parameters import read_parameters

_DIAGNOSE_S = 1.0
_PUBLISHED = {
    "/edgetree/detections": (Detection3DArray, "~/detections"),
    "/edgetree/markers": (MarkerArray, "~/markers"),
    "/edgetree/json": (String, "~/json"),
}
_INPUTS = {
    "colour": "color/image_raw",
    "depth": "depth/image_raw",
    "camera": "color/camera_info",
    "depth_camera": "depth/camera_info",
    "imu": "imu",
}


class StemNode(Node):
    """Hands frames to the live pipeline, and publishes its results.

    Attributes:
        failure: Why the pipeline ended by itself; None while it has not.

    Raises:
        EdgetreeError: A parameter, the model or a file that a parameter names cannot be used.
    """

    def __init__(self) -> None:
        super().__init__("edgetree")
        self.failure: Exception | None = None
        self._options, metres, session = read_parameters(self)
        rig_options = metres.as_rig_options()
        rig = rig_options.rig(metres.camera, None)
        detector, _ = session.open_model(self._options.model, self._options.score_threshold)
        topics = {role: self.resolve_topic_name(name) for role, name in _INPUTS.items()}
        self._source = PushedFrames("ROS topics")
        self._frames = TopicFrames(topics, rig)
        self._pipeline = LivePipeline(
            lambda: self._source,
            detector,
            rig=rig,
            settings=rig_options.settings(),
            tracker=metres.tracker(),
        )
        self._messages = RosMessages(new_message)
        self._diagnostics = RosDiagnostics(
            "edgetree: trees", self._options.stale_after, new_message
        )
        self._advertise()
        self._subscribe(topics)
        self._worker = threading.Thread(target=self._run, name="edgetree-results")
        self._worker.start()

    def _advertise(self) -> None:
        self._outputs = {
            topic: self.create_publisher(kind, name, 5)
            for topic, (kind, name) in _PUBLISHED.items()
        }
        self._diagnostic = self.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self.create_timer(_DIAGNOSE_S, self._diagnose)

    def _subscribe(self, topics: dict[str, str]) -> None:
        """Subscribe as drivers publish: pictures and samples may be lost, transforms may not."""
        sensor = qos_profile_sensor_data
        for role, kind in (("camera", CameraInfo), ("depth_camera", CameraInfo), ("imu", Imu)):
            self.create_subscription(kind, topics[role], self._adder(topics[role]), sensor)
        kept = QoSProfile(
            depth=100,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self.create_subscription(TFMessage, "/tf", self._adder("/tf"), 100)
        self.create_subscription(TFMessage, "/tf_static", self._adder("/tf_static"), kept)
        kind = CompressedImage if self._options.compressed else Image
        endings = ("/compressed", "/compressedDepth") if self._options.compressed else ("", "")
        self._pictures = [
            Subscriber(self, kind, topics[role] + ending, qos_profile=sensor)
            for role, ending in zip(("colour", "depth"), endings, strict=True)
        ]
        self._synchroniser = ApproximateTimeSynchronizer(
            self._pictures, self._options.queue_size, self._options.max_time_difference
        )
        self._synchroniser.registerCallback(self._take)

    def _adder(self, topic: str) -> Callable[[Any], None]:
        return lambda message: self._tolerant(self._frames.add, topic, message)

    def _take(self, colour: Any, depth: Any) -> None:
        """Hand over the frame of a pair of pictures."""
        frame = self._tolerant(self._frames.frame, colour, depth)
        if frame is not None:
            self._messages.camera_frame = colour.header.frame_id
            self._source.push(frame)

    def _tolerant(self, function: Callable[..., Any], *values: Any) -> Any:
        """Call a function; what cannot be used of a message is logged and counted."""
        try:
            return function(*values)
        except EdgetreeError as error:
            self._frames.counts["messages that cannot be used"] += 1
            self.get_logger().warning(str(error), throttle_duration_sec=10.0)
            return None

    def _run(self) -> None:
        """Publish the result of each frame until the source is closed."""
        try:
            for result in self._pipeline:
                self._publish(result)
        except Exception as error:  # noqa: BLE001 told by main, in the thread that spins
            self.failure = error
            rclpy.try_shutdown()

    def _publish(self, result: LiveResult) -> None:
        for topic, message in self._messages.stems(result):
            self._outputs[topic].publish(message)

    def _diagnose(self) -> None:
        now_s = self.get_clock().now().nanoseconds * 1e-9
        told = self._diagnostics.of_status(self._pipeline.status, self._frames.counts, now_s)
        self._diagnostic.publish(told)

    def close(self) -> None:
        """End the pipeline, and wait for it."""
        self._source.close()
        self._pipeline.stop()
        self._worker.join()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C; returns the exit code."""
    rclpy.init(args=args)
    try:
        node = StemNode()
    except EdgetreeError as error:
        print(f"edgetree_node: {error}", file=sys.stderr)  # noqa: T201
        rclpy.try_shutdown()
        return error.exit_code
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()
    if node.failure is None:
        return 0
    print(f"edgetree_node: {node.failure}", file=sys.stderr)  # noqa: T201
    return getattr(node.failure, "exit_code", 1)


if __name__ == "__main__":
    sys.exit(main())
