"""Datasets of simulated frames: generation, splits, contact sheets and statistics."""

__all__: list[str] = []
