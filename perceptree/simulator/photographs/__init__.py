"""Photographs of bark, ground, stones, leaves and far stands, mixed with procedural textures."""
