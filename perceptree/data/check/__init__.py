"""Check a dataset before training: files, labels, leakage between splits."""

from perceptree.data.check.findings import Finding
from perceptree.data.check.run import Check, Report, SplitSummary

__all__ = ["Check", "Finding", "Report", "SplitSummary"]
