"""Stems of trees as messages of ROS 2: detections, markers and diagnostics."""

__all__: list[str] = []
