"""Settings of a training, free of PyTorch, so that the command line can show them at once.

`training` holds what determines the result and on what machine and data; `augmentation` and
`sampling` hold parts of it. The simulator's settings are in `perceptree.simulator.settings`.
"""

__all__: list[str] = []
