"""The papers that vtff implements, as pages and CITATION.cff cite them."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["PAPERS", "Paper"]


@dataclass(frozen=True)
class Paper:
    """A paper as it is cited.

    Attributes
    ----------
    number
        Number in code and documentation.
    citation
        Authors, title, year and place.
    doi
        Digital object identifier; empty where there is none.
    """

    number: str
    citation: str
    doi: str = ""


PAPERS = {
    paper.number: paper
    for paper in (
        Paper(
            "000",
            "Y. Peng, W. A. Scales and T. R. Edwards, GPS-based satellite formation flight "
            "simulation and applications to ionospheric remote sensing, NAVIGATION 67(1), 3-21, "
            "2020.",
            "10.1002/navi.354",
        ),
        Paper(
            "001",
            "Senior project, satellite formation flight with a potential field in Matlab "
            "(navigation of clusters by a potential-field-like function).",
        ),
        Paper(
            "002",
            "F. Scala and others, natural collision-free trajectories for the extension phase of "
            "the Formation Flying L-band Aperture Synthesis mission, 2021.",
        ),
        Paper(
            "003",
            "W. H. Steyn and Y. Hashida, In-orbit attitude performance of the 3-axis stabilised "
            "SNAP-1 nanosatellite, AIAA/USU Conference on Small Satellites, 2001.",
        ),
        Paper(
            "004",
            "H. Oh and others, Improved GPS-based satellite relative navigation using femtosecond "
            "laser relative distance measurements, Journal of Astronomy and Space Sciences 33(1), "
            "45-54, 2016.",
            "10.5140/JASS.2016.33.1.45",
        ),
    )
}
"""Papers by their numbers."""
