"""Conformance kits: frames, and the trees that every program must find in them with a model file.

A program in another language runs a kit's model on its frames and writes what it found. The check
says in plain lines what differs from the trees that this package finds.
"""

from edgetree.conformance.compare import Comparison, Quantity, compare_results
from edgetree.conformance.kit import Kit, KitFrame, make_kit, read_kit, run_kit
from edgetree.conformance.results import (
    CoveredTree,
    FoundTree,
    FrameTrees,
    Results,
    read_results,
    write_results,
)
from edgetree.conformance.tolerances import Tolerance, tolerance_for

__all__ = [
    "Comparison",
    "CoveredTree",
    "FoundTree",
    "FrameTrees",
    "Kit",
    "KitFrame",
    "Quantity",
    "Results",
    "Tolerance",
    "compare_results",
    "make_kit",
    "read_kit",
    "read_results",
    "run_kit",
    "tolerance_for",
    "write_results",
]
