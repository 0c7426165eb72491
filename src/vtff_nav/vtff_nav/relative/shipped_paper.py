"""The estimator paper as a plug-in of ``vtff.estimators``; filterpy imports most of scipy."""

from __future__ import annotations

from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.paper.estimator import PaperConfiguration, PaperEstimator
from vtff_nav.relative.shipped_estimators import common_options

__all__ = ["make_paper"]


def make_paper(setting: EstimatorSetting) -> PaperEstimator:
    """Return the paper's filter of 8 states, with the phase of one signal.

    Raises
    ------
    ValueError
        If a value is not possible; the text names it.
    """
    if setting.antennas is not None and not setting.antennas.are_central:
        raise ValueError("antennas: the estimator paper takes them to be in the centres of mass")
    return PaperEstimator(PaperConfiguration(**common_options(setting)))
