"""The renderer: colour samples, exact depth and tree numbers of a scene's triangles."""

from perceptree.simulator.kernel_cache import versioned_cache as _versioned_cache

with _versioned_cache():
    from perceptree.simulator.rendering import rasterise, shade  # noqa: F401

__all__: list[str] = []
