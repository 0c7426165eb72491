"""The verdict of a run: what it was about and how it went, beside the paper and the best possible.

It opens the report and closes the console's tables. Its figures are those of the subject of the
run, in the unit that fits them; everything else follows in the sections of the report.
"""

from vtff_analysis.report.verdict.figure import length_text
from vtff_analysis.report.verdict.verdict import (
    SECTIONS,
    Verdict,
    describe_conditions,
    describe_receivers,
    find_verdict,
    printed_navigation_error,
    subject_of,
)

__all__ = [
    "SECTIONS",
    "Verdict",
    "describe_conditions",
    "describe_receivers",
    "find_verdict",
    "length_text",
    "printed_navigation_error",
    "subject_of",
]
