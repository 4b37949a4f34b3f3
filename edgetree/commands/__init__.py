"""The sub-commands of `edgetree`, one module each; what is heavy is imported inside functions."""

__all__: list[str] = []
