"""Recordings: ROS 1 bags, ROS 2 bags and MCAP files, read with the package rosbags."""

from edgetree.sources.bags.reader import BAG_SUFFIXES, is_bag
from edgetree.sources.bags.recording import open_recording

__all__ = ["BAG_SUFFIXES", "is_bag", "open_recording"]
