"""A ROS 2 bag (MCAP) of standard messages. Needs the extra `record`."""

from __future__ import annotations

from pathlib import Path

from edgetree.live.results import LiveResult
from edgetree.live.sinks.bag_folder import BagFolder, check_rosbags
from edgetree.live.sinks.ros_messages import TOPICS, RosMessages
from edgetree.live.sinks.ros_types import time_ns

__all__ = ["BagSink"]


class BagSink:
    """Writes pictures, cameras, poses and stems as a ROS 2 bag, which Foxglove and Rerun open.

    Args:
        folder: the bag, a new folder, which appears when the sink is closed. It holds
            `FOLDER.mcap` and `metadata.yaml`.

    Raises:
        InputError: the folder exists already or cannot be made.
        MissingPackage: rosbags is not installed.
    """

    def __init__(self, folder: Path) -> None:
        check_rosbags()
        self._messages = RosMessages()
        self._bag = BagFolder(folder, self._messages.store)
        self._is_open = True

    def write(self, result: LiveResult) -> None:
        """Write the messages of one result."""
        log_ns = time_ns(result.frame.time_s)
        for topic, message in self._messages.all(result):
            self._bag.write(topic, TOPICS[topic], log_ns, message)

    def close(self) -> None:
        """Complete the bag."""
        if self._is_open:
            self._is_open = False
            self._bag.close()
