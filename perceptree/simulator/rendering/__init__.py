"""From triangles to samples of colour, exact depth and tree numbers."""

from perceptree.simulator.rendering.kernel_cache import versioned_cache as _versioned_cache

with _versioned_cache():
    from perceptree.simulator.rendering import rasterise, shade  # noqa: F401

__all__: list[str] = []
