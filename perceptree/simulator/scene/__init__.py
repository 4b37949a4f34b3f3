"""Scene descriptions: terrain, trees, undergrowth, objects, weather and light, without meshes."""

__all__: list[str] = []
