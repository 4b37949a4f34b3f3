"""What the measurement assumes of stems, ground, outlines and depth, each in one place.

The docstring of a constant ends with its source: "fitted (FIT)" names the fit of
`benchmarks/fit_measure.py` that determines it, "chosen" says on what, a "bound" what bounds it.
Numbers that only say how a search runs stay in the modules. `MeasureSettings` holds what users may
change.
"""

__all__: list[str] = []
