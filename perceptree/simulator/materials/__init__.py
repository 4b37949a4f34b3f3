"""Procedural textures: bark, foliage, plants and grounds, one layer each."""
