"""From the description to triangles: stems, crowns, undergrowth, and glTF files."""

__all__: list[str] = []
