"""The report of a campaign: numbers, pictures, and commands that repeat cases."""

from __future__ import annotations

import html.parser
import re

import numpy as np
import pyarrow as pa
import pytest

from vtff_analysis.studies.bounds import Bound, judge_bound
from vtff_analysis.studies.campaign_charts import Column, association
from vtff_analysis.studies.campaign_report import CampaignDescription, render_campaign_report

CASES = 40


@pytest.fixture(scope="module")
def table():
    generator = np.random.default_rng(1)
    cap = np.linspace(1.0, 2.0, CASES)
    settling = [float(value) for value in 200.0 - 50.0 * cap]
    settling[7] = None
    status = ["complete"] * CASES
    status[3] = "hung"
    return pa.table(
        {
            "case": list(range(1, CASES + 1)),
            "status": status,
            "reason": ["" if state == "complete" else "hung: <10 s>" for state in status],
            "cap": cap,
            "design": ["paper", "delay_aware"] * (CASES // 2),
            "constant": [3] * CASES,
            "settling_time_s": [None if n == 3 else value for n, value in enumerate(settling)],
            "final_radial_m": generator.normal(size=CASES),
            "wall_time_s": [1.0] * CASES,
            "processor_time_s": [0.5] * CASES,
        }
    )


@pytest.fixture(scope="module")
def page(table):
    bound = Bound("settling_time_s", at_most=145.0)
    return render_campaign_report(
        table,
        CampaignDescription(
            name="trial <1>",
            description="a & b",
            inputs={"cap": "m/s²", "design": "", "constant": ""},
            figures=["settling_time_s", "final_radial_m"],
            verdicts=[judge_bound(bound, table["settling_time_s"].to_pylist())],
            planned=CASES,
            repeat=lambda number: f"vtff campaign trial --case {number}",
            facts=[("seed of the campaign", "1")],
        ),
    )


def cells(page):
    text = re.sub(r"<(td|th)[^>]*>", "|", page)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", text))


def test_the_page_is_well_formed_and_escaped(page):
    stack = []

    class Checker(html.parser.HTMLParser):
        def handle_starttag(self, tag, attributes):
            if tag not in ("meta", "link", "img", "br", "wbr"):
                stack.append(tag)

        def handle_endtag(self, tag):
            assert stack.pop() == tag

    Checker().feed(page)
    assert stack == []
    assert "trial &lt;1&gt;" in page and "hung: &lt;10 s&gt;" in page and "a &amp; b" in page


def test_percentiles_are_those_of_the_complete_cases(page, table):
    values = [v for v in table["settling_time_s"].to_pylist() if v is not None]
    text = cells(page)
    assert f"settling time (s)|{len(values)}" in text.replace(" |", "|")
    for percentile in (0, 5, 50, 95, 100):
        # All of a figure to the same place, here three digits of a range of tens.
        assert f"|{np.percentile(values, percentile):.1f}" in text


def test_the_bound_and_the_failed_case_are_told(page):
    text = cells(page)
    assert "145 s in every case" in text and "does not hold" in text
    assert "|hung |hung: &lt;10 s&gt;vtff campaign trial --case 4" in text
    assert "39 of 40" in text


def test_the_page_opens_with_its_bounds_and_medians(page, table):
    median = np.median([v for v in table["settling_time_s"].to_pylist() if v is not None])
    sentence = page[page.index('class="sentence"') : page.index("</p></div>")]
    assert f"settling time {median:.1f} s" in sentence


def test_figures_and_variables_stand_in_words(page):
    text = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    assert "final radial (m)" in cells(text)
    assert not re.findall(r"settling_time_s|final_radial_m", cells(text))


@pytest.mark.parametrize(
    ("kept", "state"), [(20, "holds"), (11, "not shown"), (5, "does not hold")]
)
def test_too_few_cases_are_not_called_a_failure(kept, state):
    bound = Bound("settling_time_s", at_most=1.0, fraction=0.5)
    verdict = judge_bound(bound, [0.5] * kept + [2.0] * (20 - kept))
    assert verdict.state == state and verdict.holds == (state == "holds")


def test_the_worst_cases_have_a_command_each(page):
    worst = page[page.index('id="worst"') : page.index('id="failed"')]
    # Without a value, then beyond the bound from the largest on.
    assert re.findall(r"--case (\d+)", worst)[:3] == ["8", "1", "2"]
    assert worst.count("vtff campaign trial --case") == 6
    assert "breaks its bound" in worst and "largest" in worst and "smallest" in worst


def test_pictures_are_there(page):
    assert page.count('src="data:image/png;base64,') == 3


def test_a_campaign_of_failures_has_a_report(table):
    failed = table.set_column(1, "status", pa.array(["failed"] * CASES))
    description = CampaignDescription(
        "x", "", {"cap": ""}, ["settling_time_s"], [], CASES, str, [("a", "b")]
    )
    page = render_campaign_report(failed, description)
    assert 'id="drivers"' not in page and "data:image" not in page and 'id="failed"' in page


def test_association_finds_what_drives_a_figure():
    generator = np.random.default_rng(2)
    driver = Column("x", "", generator.normal(size=300))
    rising = Column("f", "", np.exp(driver.values))
    assert association(driver, rising) == pytest.approx(1.0)
    assert association(driver, Column("f", "", -(driver.values**3))) == pytest.approx(-1.0)
    assert abs(association(driver, Column("f", "", generator.normal(size=300)))) < 0.2
    assert np.isnan(association(driver, Column("f", "", np.ones(300))))
    groups = Column("g", "", np.repeat([0.0, 1.0, 2.0], 100), ("a", "b", "c"))
    means = np.repeat([5.0, -3.0, 5.1], 100)
    strong = Column("f", "", means + 0.01 * generator.normal(size=300))
    assert association(groups, strong) > 0.9
    assert association(groups, Column("f", "", generator.normal(size=300))) < 0.2
