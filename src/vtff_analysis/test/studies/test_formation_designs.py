"""The study of formations without thrust."""

import csv

import pytest

from vtff_analysis.studies.formation_designs import (
    fflas_formations,
    fly_formation,
    model_error,
    write_formation_designs,
)


def test_paper_002_by_formation(tmp_path):
    closest = {}
    pairs = []
    for name, relative in fflas_formations().items():
        flown = fly_formation(name, relative)
        pairs += [("osculating", pair) for pair in flown]
        closest[name] = min(flown, key=lambda pair: pair.closest)
        if name == "helix":
            assert min(pair.closest_radial_normal for pair in flown) >= 12.0
            assert all(pair.designed.separation_radial_normal > 12.0 for pair in flown)
    assert closest["pco"].closest == pytest.approx(20.9, abs=0.5)
    literal = closest["pco_literal"]
    assert (literal.first, literal.second) == ("B", "C")
    assert literal.closest == pytest.approx(0.12, abs=0.1)
    in_mean = fly_formation("pco", fflas_formations()["pco"], "mean", orbits=2)
    assert min(pair.closest for pair in in_mean) > 22.0

    errors = model_error(250.0, 0.01, orbits=1)
    assert max(error.percent for error in errors) < 0.04
    paths = write_formation_designs(tmp_path, errors, pairs)
    with paths[1].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 9
    assert float(rows[0]["closest_m"]) == pairs[0][1].closest


def test_unknown_elements_are_refused():
    with pytest.raises(ValueError, match="osculating or mean"):
        fly_formation("pco", fflas_formations()["pco"], "Brouwer")
