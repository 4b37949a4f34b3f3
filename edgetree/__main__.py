"""`python -m edgetree`: the command line."""

from edgetree.cli import main

__all__: list[str] = []

main()
