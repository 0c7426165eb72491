"""Lines of figures as data: nothing of them is lost, other figures stay pictures."""

import base64
import json
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_analysis.page.line_data import line_data
from vtff_analysis.page.page import lines_path
from vtff_analysis.plot_style import FIGURES_VARIABLE, make_figure, save_figure


def unpacked(packed):
    return packed["middle"] + np.frombuffer(base64.b64decode(packed["float32"]), "<f4")


def drawn(draw, rows=1, columns=1):
    figure = make_figure(4.0)
    draw(figure.subplots(rows, columns, squeeze=False))
    figure.get_layout_engine().execute(figure)
    return with_arrays(line_data(figure))


def with_arrays(data):
    """Put the arrays of lines in the place of their numbers."""
    if data is None:
        return None
    for line in (line for row in data["rows"] for panel in row for line in panel["lines"]):
        line.update({axis: data["arrays"][line[axis]] for axis in ("x", "y") if axis in line})
    return data


def test_a_line_keeps_micrometres_of_kilometres():
    x = np.linspace(0.0, 3600.0, 1001)
    y = -15_000.0 + 1e-3 * np.sin(x)
    data = drawn(lambda axes: axes[0, 0].plot(x, y, color="#D55E00", linestyle="--", label="a"))
    (line,) = data["rows"][0][0]["lines"]
    assert (line["name"], line["colour"], line["dash"]) == ("a", "#d55e00", [5, 3])
    np.testing.assert_allclose(unpacked(line["x"]), x, atol=2e-4)
    np.testing.assert_allclose(unpacked(line["y"]), y, atol=1e-9)


def test_a_faint_line_stays_faint():
    """Errors of an attitude that may not steer are, in reports."""

    def draw(axes):
        for opacity in (0.25, 1.0, None):
            axes[0, 0].plot([0.0, 1.0], [2.0, 3.0], color="#D55E00", alpha=opacity)

    lines = drawn(draw)["rows"][0][0]["lines"]
    assert [line["colour"] for line in lines] == ["#d55e0040", "#d55e00ff", "#d55e00"]


def test_figures_are_svg_too_where_that_is_asked_for(tmp_path, monkeypatch):
    def save(name):
        figure = make_figure(3.0)
        figure.subplots().plot([0.0, 1.0], [2.0, 3.0], label="line")
        save_figure(figure, tmp_path / name, "Two points")

    save("plain.png")
    assert not list(tmp_path.glob("*.svg"))
    monkeypatch.setenv(FIGURES_VARIABLE, "svg")
    save("same.png")
    first = (tmp_path / "same.svg").read_bytes()
    save("same.png")
    assert (tmp_path / "same.svg").read_bytes() == first
    assert ElementTree.fromstring(first).tag.endswith("svg")
    assert (tmp_path / "plain.png").read_bytes() == (tmp_path / "same.png").read_bytes()


def test_panels_are_in_their_rows_with_their_labels():
    def draw(axes):
        for number, panel in enumerate(axes.flat):
            panel.plot([0, 1], [0, number])
            panel.set_title(str(number), loc="left")
            panel.set_ylabel("m")
        axes[1, 0].set_yscale("log")

    data = drawn(draw, 2, 2)
    assert [[panel["title"] for panel in row] for row in data["rows"]] == [["0", "1"], ["2", "3"]]
    assert data["rows"][1][0]["log"] == [False, True]
    assert data["rows"][1][1]["y"] == "m"


def test_lines_through_the_panel_and_areas():
    def draw(axes):
        axes[0, 0].plot([0, 10], [1, 2])
        axes[0, 0].axvline(4.0)
        axes[0, 0].axhline(1.5, linestyle=":")
        axes[0, 0].fill_between([0, 10], [0, 1], [2, 3], color="0.85", label="band")

    lines = drawn(draw)["rows"][0][0]["lines"]
    assert [line.get("upright") for line in lines] == [None, None, 4.0, None]
    assert [line.get("across") for line in lines] == [None, None, None, 1.5]
    (band,) = [line for line in lines if line.get("area")]
    corners = np.column_stack((unpacked(band["x"]), unpacked(band["y"])))
    for corner in ((0, 0), (10, 1), (10, 3), (0, 2)):
        assert (np.abs(corners - corner).max(axis=1) < 1e-6).any()


@pytest.mark.parametrize(
    "draw",
    [
        lambda axes: axes[0, 0].scatter([0, 1], [0, 1], c=[0.0, 1.0]),
        lambda axes: axes[0, 0].imshow(np.eye(3)),
        lambda axes: axes[0, 0].bar([0, 1], [1, 2]),
        lambda axes: (axes[0, 0].plot([0, 1], [0, 1]), axes[0, 0].set_aspect("equal")),
        lambda axes: None,
    ],
    ids=["colours", "image", "bars", "equal scales", "nothing"],
)
def test_other_figures_stay_pictures(draw):
    assert drawn(draw) is None


@given(
    st.integers(0, 2**32), st.integers(2401, 30_000), st.sampled_from([0.0, 1e-4, 0.5, 0.999, 1.0])
)
@settings(deadline=None, max_examples=30)
def test_a_long_line_keeps_its_extremes_and_gaps(seed, count, missing):
    generator = np.random.default_rng(seed)
    y = np.where(generator.random(count) < missing, np.nan, generator.normal(0.0, 100.0, count))
    data = drawn(lambda axes: axes[0, 0].plot(np.arange(y.size), y))
    (line,) = data["rows"][0][0]["lines"]
    kept = unpacked(line["y"])
    assert kept.size <= 2400
    assert np.isnan(kept).any() == np.isnan(y).any()
    if np.isfinite(y).any():
        assert np.nanmax(kept) == pytest.approx(np.nanmax(y), abs=1e-4)
        assert np.nanmin(kept) == pytest.approx(np.nanmin(y), abs=1e-4)


def test_lines_of_equal_times_share_them():
    time = np.arange(500.0)
    data = drawn(
        lambda axes: [panel.plot(time, time**k) for k, panel in enumerate(axes.flat)], 2, 2
    )
    assert len(data["arrays"]) == 4  # time, which is also the first power, 1, and two powers


def test_many_lines_over_each_other_are_thinned_with_their_extremes():
    generator = np.random.default_rng(1)
    values = generator.normal(0.0, 1.0, (30, 2700))
    data = drawn(lambda axes: [axes[0, 0].plot(np.arange(2700), row, ".") for row in values])
    lines = data["rows"][0][0]["lines"]
    kept = [unpacked(line["y"]) for line in lines]
    assert sum(map(len, kept)) <= 12_000
    for row, drawn_row in zip(values, kept, strict=True):
        assert drawn_row.max() == pytest.approx(row.max(), abs=1e-5)
        assert drawn_row.min() == pytest.approx(row.min(), abs=1e-5)


def test_the_file_stands_beside_the_picture_and_goes_with_it(tmp_path):
    figure = make_figure(3.0)
    figure.subplots().plot([0, 1], [2, 3])
    path = save_figure(figure, tmp_path / "a.png", "title")
    assert json.loads(lines_path(path).read_text())["rows"][0][0]["lines"]
    figure = make_figure(3.0)
    figure.subplots().imshow(np.eye(2))
    save_figure(figure, path, "title")
    assert not lines_path(path).exists()


def test_names_on_an_axis_and_powers_in_its_label_are_kept():
    def draw(axes):
        axes[0, 0].plot([0.0, 1.0], [1.0, 4.0])
        axes[0, 0].set_yticks([1, 4], ["predicted", "fixed"])
        axes[0, 0].set_ylabel("$N_e$ (10$^{12}$ m$^{-3}$), mA m$^2$")

    (panel,) = drawn(draw)["rows"][0]
    assert panel["ticks"] == [(1.0, "predicted"), (4.0, "fixed")]
    assert panel["y"] == "Nₑ (10¹² m⁻³), mA m²"
    (plain,) = drawn(lambda axes: axes[0, 0].plot([0.0, 1.0], [1.0, 4.0]))["rows"][0]
    assert plain["ticks"] == []


def test_a_scale_that_is_logarithmic_on_both_sides_is_the_one_of_the_picture():
    figure = make_figure(3.0)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [-30.0, 40.0])
    axes.set_yscale("symlog", linthresh=2.0, linscale=1.5)
    limit, part = line_data(figure)["rows"][0][0]["symlog"]
    values = np.array([-30.0, -2.0, -0.5, 0.0, 1.0, 2.0, 2.1, 40.0])
    size = np.abs(values) / limit
    beyond = part + np.log10(np.maximum(size, 1.0))
    drawn_at = np.sign(values) * np.where(size <= 1.0, part * size, beyond)
    np.testing.assert_allclose(drawn_at * limit, axes.yaxis.get_transform().transform(values))
    axes.set_yscale("linear")
    assert line_data(figure)["rows"][0][0]["symlog"] is None
