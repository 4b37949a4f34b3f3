"""How fast a model file is on this machine, beside the paper's table."""

from edgetree.bench.speed import BenchResult, bench_detector

__all__ = ["BenchResult", "bench_detector"]
