"""Report of a run: its numbers and histories as tables, plots and one HTML page.

The numbers are made in `vtff_analysis.evaluation.summary`, the rows and heads of the tables in
`vtff_analysis.report.tables`, the columns of the papers in `vtff_analysis.paper_reference`.
"""

from vtff_analysis.report.write import write_report

__all__ = ["write_report"]
