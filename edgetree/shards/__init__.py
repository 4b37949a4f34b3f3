"""Frames on several machines: their files, the work on a block of them, and the merged results."""

__all__: list[str] = []
