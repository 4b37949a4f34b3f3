"""Captures of phones with a depth camera: colour, depth, camera, pose and gravity of each frame."""

__all__: list[str] = []
