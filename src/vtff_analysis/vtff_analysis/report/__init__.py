"""Report of a run: bag to arrays, arrays to numbers, numbers to tables and plots."""

from vtff_analysis.report.write import write_report

__all__ = ["write_report"]
