"""HTML pages: the report of `edgetree run` and `measure`, and what it shares with the demo's."""

from edgetree.report.frame_report import ReportHead, report_file

__all__ = ["ReportHead", "report_file"]
