"""Labels of the trees in a view, and their COCO records."""

__all__: list[str] = []
