"""A command-line program: its process, console and signals."""

__all__: list[str] = []
