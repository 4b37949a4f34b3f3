"""Cameras: those that OpenCV reads, and those with a package of their maker."""

__all__: list[str] = []
