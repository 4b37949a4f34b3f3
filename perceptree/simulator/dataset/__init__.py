"""Datasets of simulated frames: generation, resuming, splits, contact sheets and statistics."""

__all__: list[str] = []
