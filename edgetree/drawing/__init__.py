"""Draw trees on their picture, with labels that stay clear of each other."""

from edgetree.drawing.trees import CutMark, draw_trees, picture_of_depth

__all__ = ["CutMark", "draw_trees", "picture_of_depth"]
