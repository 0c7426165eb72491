"""Report of a run: its numbers and histories as tables, plots and one HTML page."""

from vtff_analysis.report.write import write_report

__all__ = ["write_report"]
