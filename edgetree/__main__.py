"""Entry point of `python -m edgetree`."""

from edgetree.cli import main

__all__: list[str] = []

main()
