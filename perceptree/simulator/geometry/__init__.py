"""Triangle meshes of scenes: stems, crowns, undergrowth and objects; export as glTF.

Shape parameters of the meshes were chosen by eye.
"""

__all__: list[str] = []
