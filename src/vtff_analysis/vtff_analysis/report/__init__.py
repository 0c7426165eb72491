"""Report of a run: its numbers and histories as tables, plots and one HTML page.

The numbers themselves (a row or column of a report) are made in `vtff_analysis.evaluation.summary`.
"""

from vtff_analysis.report.write import write_report

__all__ = ["write_report"]
