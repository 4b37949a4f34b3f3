"""Procedural textures: bark, foliage, plants and grounds, one layer each."""

__all__: list[str] = []
