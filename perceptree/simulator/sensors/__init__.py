"""What the sensors make of a drawing: a colour image, a depth map, rain and flakes."""

__all__: list[str] = []
