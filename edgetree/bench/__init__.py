"""Measure the speed of model files, and compare it with the paper's table."""

from edgetree.bench.speed import BenchResult, bench_detector

__all__ = ["BenchResult", "bench_detector"]
