"""What is true of each tree in a view, and its COCO record."""

__all__: list[str] = []
