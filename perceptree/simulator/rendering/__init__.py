"""From triangles to samples of colour, exact depth and tree numbers."""
