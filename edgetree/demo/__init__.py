"""The demonstration of `edgetree demo`: run models on frames with ground truth, write a report."""

from edgetree.demo.report import NextCommand, render_report
from edgetree.demo.result import DemoResult
from edgetree.demo.running import Progress, demonstrate, run_embedded, write_report

__all__ = [
    "DemoResult",
    "NextCommand",
    "Progress",
    "demonstrate",
    "render_report",
    "run_embedded",
    "write_report",
]
