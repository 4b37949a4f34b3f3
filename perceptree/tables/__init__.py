"""Reproduce the paper's tables 2 and 3 at a chosen scale, next to the paper's numbers."""

from perceptree.tables.build import build_table
from perceptree.tables.page import table_lines
from perceptree.tables.plan import TABLES, TableSettings
from perceptree.tables.results import Watch

__all__ = ["TABLES", "TableSettings", "Watch", "build_table", "table_lines"]
