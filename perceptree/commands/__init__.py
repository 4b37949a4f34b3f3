"""The commands of the perceptree command line, one module each."""

__all__: list[str] = []
