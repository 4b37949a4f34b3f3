"""The sub-commands of `edgetree`, one module each. Heavy modules are imported in functions."""

__all__: list[str] = []
