"""Recordings: ROS 1 bags, ROS 2 bags and MCAP files, read with the package rosbags."""

__all__: list[str] = []
