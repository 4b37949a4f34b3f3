"""Sensor models: colour camera, depth camera, and rain and snow in the air."""

__all__: list[str] = []
