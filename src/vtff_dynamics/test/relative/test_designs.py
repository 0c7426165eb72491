"""Shapes of the formation designs, their safety, and paper 002's orbit flown without thrust."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from j2_truth import fly

from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.mean_elements import state_from_elements
from vtff_dynamics.relative import designs
from vtff_dynamics.relative.relative_elements import elements_of_deputy, linear_map_rtn
from vtff_dynamics.relative.separation import radial_normal_separation, safety_figures

LATITUDE = np.linspace(0.0, 2.0 * math.pi, 400)
PHASES = (1.5 * math.pi, math.pi / 6.0, 5.0 * math.pi / 6.0)  # table 4: A, B, C
AXIS = 7153100.0
PERIOD = 2.0 * math.pi * math.sqrt(AXIS**3 / 3.986004415e14)


def motion(relative):
    return (linear_map_rtn(1e-3, LATITUDE)[:, :3] @ relative).T


def test_every_design_is_named():
    assert all(callable(getattr(designs, name)) for name in designs.DESIGNS)


def test_shapes():
    _, t, n = motion(designs.projected_circular_track_normal(80.0, 0.4))
    np.testing.assert_allclose(np.hypot(t, n), 80.0)
    r, _, n = motion(designs.projected_circular_radial_normal(80.0, 0.4))
    np.testing.assert_allclose(np.hypot(r, n), 80.0)
    np.testing.assert_allclose(
        np.linalg.norm(motion(designs.general_circular(80.0, 0.4)), axis=0), 80.0
    )
    r, t, n = motion(designs.cartwheel(80.0, 0.4))
    np.testing.assert_allclose(np.hypot(r, t / 2.0), 80.0)
    np.testing.assert_allclose(n, 0.0)
    np.testing.assert_allclose(motion(designs.leader_follower(80.0))[1], 80.0)
    assert LATITUDE[np.argmin(motion(designs.helix(80.0, 30.0, 0.4))[0])] == pytest.approx(
        0.4, abs=0.02
    )


@given(st.lists(st.floats(-100.0, 100.0), min_size=4, max_size=4))
def test_closed_form_of_the_radial_normal_separation(vectors):
    relative = np.array([0.0, 0.0, *vectors])
    latitude = np.linspace(0.0, 2.0 * math.pi, 20001)
    r, _, n = (linear_map_rtn(1e-3, latitude)[:, :3] @ relative).T
    assert radial_normal_separation(relative) == pytest.approx(np.hypot(r, n).min(), abs=0.05)


def test_safety_tells_a_helix_from_a_projected_circle():
    safe = safety_figures(designs.helix(7.5, 15.0, 0.3))
    assert safe.separation_radial_normal == pytest.approx(7.5)
    assert safe.angle == pytest.approx(0.0, abs=1e-6)
    unsafe = safety_figures(designs.projected_circular_track_normal(15.0, 0.3))
    assert unsafe.separation_radial_normal == pytest.approx(0.0, abs=1e-9)
    assert unsafe.angle == pytest.approx(0.5 * math.pi)
    assert unsafe.separation == pytest.approx(15.0, rel=1e-3)
    drifting = safety_figures([2.0, 0.0, 7.5, 0.0, 15.0, 0.0])
    assert drifting.separation_radial_normal == pytest.approx(5.5, abs=0.3)


def test_free_flight_of_the_formations_of_paper_002():
    """The row of issue 15: PCO 20.9 m, its equation (7) literally 0.12 m, helix 12.7 m."""
    formations = {
        "pco": [
            designs.projected_circular_track_normal(15.0, -(alpha + 0.5 * math.pi))
            for alpha in PHASES
        ],
        "helix": [designs.helix(7.5, 15.0, -(alpha + 0.5 * math.pi)) for alpha in PHASES],
    }
    formations["literal"] = [
        relative + [0.0, 15.0 * math.cos(alpha), 0.0, 0.0, 0.0, 0.0]
        for relative, alpha in zip(formations["pco"], PHASES, strict=True)
    ]
    chief = np.array([AXIS, 0.0, 0.0, 0.0, math.radians(98.51), math.radians(270.0)])
    relatives = [relative for group in formations.values() for relative in group]
    states = [chief, *(elements_of_deputy(chief, relative) for relative in relatives)]
    times = np.linspace(0.0, 15.0 * PERIOD, 15 * 120 + 1)
    flown = fly([state_from_elements(elements) for elements in states], times)
    frames = np.array([rotation_gcrf_to_rtn(state) for state in flown[:, 0]])
    closest, radial_normal = {}, {}
    for group, name in enumerate(formations):
        for first, second in itertools.combinations(range(3), 2):
            one, other = 1 + 3 * group + first, 1 + 3 * group + second
            rtn = np.einsum("nij,nj->ni", frames, flown[:, other, :3] - flown[:, one, :3])
            closest[name, first, second] = np.linalg.norm(rtn, axis=1).min()
            radial_normal[name, first, second] = np.hypot(rtn[:, 0], rtn[:, 2]).min()
    pco = [value for key, value in closest.items() if key[0] == "pco"]
    assert min(pco) == pytest.approx(20.9, abs=0.5)
    assert min(pco) >= 20.0
    assert closest["literal", 1, 2] == pytest.approx(0.12, abs=0.1)
    assert min(value for key, value in radial_normal.items() if key[0] == "helix") >= 12.0
    assert min(value for key, value in radial_normal.items() if key[0] == "pco") < 0.2
