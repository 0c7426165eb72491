"""Samples that were rejected are not drawn as if they were good."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_analysis.recordings.history import SatelliteColumns
from vtff_analysis.report import plots_details
from vtff_iono.content.slant_tec import Rejection

SECOND = 1_000_000_000


def columns(rejected_before):
    """One satellite, 100 s; until some second its content is 11 TECU off and rejected."""
    seconds = np.arange(100)
    is_rejected = seconds < rejected_before
    reason = np.where(is_rejected, float(Rejection.NO_RECEIVER_BIAS), 0.0)
    content = np.where(is_rejected, 41.0, 30.0)
    count = len(seconds)
    return SatelliteColumns(
        seconds * SECOND,
        np.zeros(count, dtype=np.uint8),
        np.full(count, 5, dtype=np.uint8),
        {"stec_tecu": content, "rejected": reason},
    )


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """A function that returns the lines and the title of the panel that would be saved."""

    def draw(content, **options):
        figures = []
        monkeypatch.setattr(plots_details, "save_figure", lambda figure, *_: figures.append(figure))
        panels = {"stec_tecu": ("slant TEC", "TECU")}
        plots_details.plot_satellite_values(
            content, panels, 0, tmp_path / "x.png", "title", **options
        )
        panel = figures[0].axes[0]
        return [line for line in panel.lines if len(line.get_xdata())], panel.get_title("left")

    return draw


def test_contents_before_the_bias_is_known_make_no_jump(drawn):
    """One of the misleading cases: a jump of 2 to 11 TECU where the bias became known."""
    (line,), title = drawn(columns(40))
    assert set(line.get_ydata()) == {30.0} and line.get_xdata()[0] == 40.0
    assert "40 %" in title and "no receiver bias" in title


def test_good_samples_are_all_drawn(drawn):
    (line,), title = drawn(columns(0))
    assert len(line.get_xdata()) == 100 and title == "slant TEC"
    assert line.get_color() != "0.75"


def test_samples_that_are_all_rejected_are_grey_and_said(drawn):
    (line,), title = drawn(columns(100))
    assert line.get_color() == "0.75" and "all samples were rejected" in title


def test_medians_show_what_noise_hides(drawn):
    """Samples are pale, the line has 30 medians over the time, the last sample in the last."""
    content = columns(0)
    content.values["stec_tecu"][::10] += 5.0
    (samples, line), title = drawn(content, has_medians=True)
    assert samples.get_alpha() < 0.5 and "medians of 3 s" in title
    assert len(line.get_xdata()) == 30 and set(line.get_ydata()) == {30.0}
