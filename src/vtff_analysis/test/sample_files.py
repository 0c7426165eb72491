"""The sample bag, flown with the project's own emulator, as RINEX files."""

from __future__ import annotations

import pathlib
from typing import NamedTuple

import pytest

SAMPLE_BAG = pathlib.Path(__file__).resolve().parents[3] / "bags" / "sample"


class SampleFiles(NamedTuple):
    """Observations of the deputy (rover) and of the chief (base), and the ephemerides."""

    rover: pathlib.Path
    base: pathlib.Path
    navigation: pathlib.Path


def require_sample_bag() -> pathlib.Path:
    """Return the sample bag, or skip the test where the checkout has none."""
    if not SAMPLE_BAG.is_dir():
        pytest.skip("the sample bag is not there")
    return SAMPLE_BAG


def export_sample(folder: pathlib.Path) -> SampleFiles:
    """Write the sample bag as RINEX files: 141 epochs in orbit, GPS L1 and L2 at 1 Hz."""
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from vtff_analysis.export.rinex import export_rinex
    from vtff_bag.file.reader import BagReader

    export_rinex(BagReader(require_sample_bag()), folder)
    return SampleFiles(folder / "deputy.rnx", folder / "chief.rnx", folder / "chief_nav.rnx")
