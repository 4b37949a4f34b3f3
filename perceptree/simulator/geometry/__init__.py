"""From the description to triangles: stems, crowns, undergrowth, and glTF files."""
