"""Classical, quasi-nonsingular and relative orbital elements."""

import dataclasses
import math

import numpy as np
import pytest
from dynamics_scenarios import EPOCH, remote_sensing_elements
from hypothesis import assume, given
from hypothesis import strategies as st

from vtff_dynamics.constants import GM_EARTH, J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.orbit.elements import (
    ClassicalElements,
    QuasiNonsingularElements,
    RelativeOrbitalElements,
    deputy_elements,
    mean_anomaly_from_true,
    relative_orbital_elements,
    true_anomaly_from_mean,
)
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.relative.motion import hcw_transition_matrix

angles = st.floats(0.0, 2 * math.pi, exclude_max=True)
orbits = st.builds(
    ClassicalElements,
    semi_major_axis=st.floats(6.6e6, 4.3e7),
    eccentricity=st.floats(0.0, 0.9),
    inclination=st.floats(0.0, math.pi),
    right_ascension=angles,
    argument_of_perigee=angles,
    true_anomaly=angles,
)


def j2_nodal_rate(elements: ClassicalElements) -> float:
    """Return the secular rate of the node by J2, rad/s, of mean elements.

    References
    ----------
    Vallado (2013), Fundamentals of Astrodynamics and Applications, eq. (9-37).
    """
    parameter = elements.semi_major_axis * (1.0 - elements.eccentricity**2)
    return (
        -1.5
        * elements.mean_motion
        * J2_EARTH
        * (RADIUS_EARTH_JGM3 / parameter) ** 2
        * math.cos(elements.inclination)
    )


@given(orbits)
def test_elements_and_state_are_inverse(elements):
    state = elements.to_state()
    back = ClassicalElements.from_state(state)
    assert back.semi_major_axis == pytest.approx(elements.semi_major_axis, rel=1e-11)
    assert back.eccentricity == pytest.approx(elements.eccentricity, abs=1e-11)
    assert back.inclination == pytest.approx(elements.inclination, abs=1e-7)
    again = back.to_state()
    np.testing.assert_allclose(again[:3], state[:3], atol=1e-4)
    np.testing.assert_allclose(again[3:], state[3:], atol=1e-6)


@pytest.mark.parametrize("eccentricity", [0.0, 0.1])
@pytest.mark.parametrize("inclination", [0.0, math.pi, 1.0])
def test_singular_orbits_keep_their_state(eccentricity, inclination):
    state = ClassicalElements(7e6, eccentricity, inclination, 0.4, 0.5, 0.6).to_state()
    np.testing.assert_allclose(
        ClassicalElements.from_state(state).to_state(), state, rtol=1e-12, atol=1e-6
    )


@given(st.floats(-20.0, 20.0), st.floats(0.0, 0.99))
def test_mean_and_true_anomaly_are_inverse(mean, eccentricity):
    true = true_anomaly_from_mean(mean, eccentricity)
    assert mean_anomaly_from_true(true, eccentricity) == pytest.approx(mean, abs=1e-12)
    assert abs(true - mean) < math.pi


def test_mean_anomaly_against_quadrature_of_kepler_second_law():
    eccentricity, true = 0.3, 2.0
    nodes, weights = np.polynomial.legendre.leggauss(60)
    anomalies = 0.5 * true * (nodes + 1.0)
    area = 0.5 * true * np.sum(weights / (1 + eccentricity * np.cos(anomalies)) ** 2)
    expected = area * (1 - eccentricity**2) ** 1.5
    assert mean_anomaly_from_true(true, eccentricity) == pytest.approx(expected, rel=1e-13)


@given(orbits)
def test_state_of_elements_has_their_energy_and_momentum(elements):
    state = elements.to_state()
    energy = state[3:] @ state[3:] / 2 - GM_EARTH / np.linalg.norm(state[:3])
    assert energy == pytest.approx(-GM_EARTH / (2 * elements.semi_major_axis), rel=1e-10)
    momentum = np.cross(state[:3], state[3:])
    parameter = elements.semi_major_axis * (1 - elements.eccentricity**2)
    assert np.linalg.norm(momentum) == pytest.approx(math.sqrt(GM_EARTH * parameter), rel=1e-12)


@given(orbits)
def test_quasi_nonsingular_elements_describe_the_same_orbit(elements):
    back = QuasiNonsingularElements.from_classical(elements).to_classical()
    np.testing.assert_allclose(back.to_state(), elements.to_state(), rtol=1e-8, atol=1e-4)


small = st.floats(-1e-3, 1e-3)


@given(orbits, st.builds(RelativeOrbitalElements, small, small, small, small, small, small))
def test_relative_elements_and_deputy_are_inverse(chief, relative):
    assume(0.05 < chief.inclination < math.pi - 0.05 and chief.eccentricity < 0.89)
    back = relative_orbital_elements(chief, deputy_elements(chief, relative))
    np.testing.assert_allclose(dataclasses.astuple(back), dataclasses.astuple(relative), atol=1e-12)


def test_relative_elements_predict_the_relative_state_on_a_circle():
    # D'Amico (2010), eq. (2.17): the linear map for a near-circular chief.
    a, u = 7e6, 0.7
    chief = ClassicalElements(a, 0.0, 1.0, 0.4, 0.0, u)
    relative = RelativeOrbitalElements(1e-6, 20e-6, 3e-6, -4e-6, 5e-6, 6e-6)
    deputy = deputy_elements(chief, relative)
    da, dl, ex, ey, ix, iy = relative.to_lengths(a)
    expected = [
        da - ex * math.cos(u) - ey * math.sin(u),
        dl + 2 * ex * math.sin(u) - 2 * ey * math.cos(u),
        ix * math.sin(u) - iy * math.cos(u),
    ]
    state = relative_state_rtn(chief.to_state(), deputy.to_state())
    np.testing.assert_allclose(state[:3], expected, atol=5e-3)
    # And the same linear theory carried for a quarter of an orbit.
    quarter = math.pi / 2 / chief.mean_motion
    later = hcw_transition_matrix(chief.mean_motion, quarter) @ state
    u += math.pi / 2
    along_track = dl - 1.5 * da * math.pi / 2 + 2 * ex * math.sin(u) - 2 * ey * math.cos(u)
    assert later[1] == pytest.approx(along_track, abs=2e-2)


def test_remote_sensing_formation_has_the_relative_state_of_the_paper():
    chief, deputy = remote_sensing_elements()
    relative = relative_state_rtn(chief.to_state(), deputy.to_state())
    assert relative[0] == pytest.approx(-854.3, abs=0.5)
    assert relative[1] == pytest.approx(-14980.0, abs=3.0)
    assert relative[2] == pytest.approx(0.0, abs=0.5)
    np.testing.assert_allclose(relative[3:], [-0.033, 1.760, 0.0], atol=2e-3)


def test_node_precesses_under_j2_as_theory_says():
    elements = ClassicalElements(7.1e6, 0.001, math.radians(50), 1.0, 0.3, 0.0)
    model = ForceModel(degree=2, order=0)
    step = 20.0
    propagator = Propagator(EPOCH, elements.to_state(), model, step=step)
    revolutions = 5
    # Between passages of the ascending node short-period terms cancel to first order.
    draconic = 2 * math.pi / elements.mean_motion
    nodes, axes = [], []
    for _ in range(int(revolutions * draconic / step)):
        osculating = ClassicalElements.from_state(propagator.advance())
        nodes.append(osculating.right_ascension)
        axes.append(osculating.semi_major_axis)
    times = np.arange(1, len(nodes) + 1) * step
    slope = np.polyfit(times, nodes, 1)[0]
    mean = dataclasses.replace(elements, semi_major_axis=float(np.mean(axes)))
    assert slope == pytest.approx(j2_nodal_rate(mean), rel=0.01)


@pytest.mark.parametrize(
    ("field", "value"),
    [("semi_major_axis", -1.0), ("semi_major_axis", 0.0), ("eccentricity", 1.0)]
    + [("eccentricity", -0.1)]
    + [("inclination", 4.0), ("true_anomaly", math.nan)],
)
def test_errors_name_the_element(field, value):
    good = ClassicalElements(7e6, 0.1, 1.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=field):
        dataclasses.replace(good, **{field: value})


def test_states_without_an_ellipse_are_errors():
    with pytest.raises(ValueError, match="orbital plane"):
        ClassicalElements.from_state([7e6, 0, 0, 1e3, 0, 0])
    with pytest.raises(ValueError, match="ellipse"):
        ClassicalElements.from_state([7e6, 0, 0, 0, 1.2e4, 0])
    chief = ClassicalElements(7e6, 0.1, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="equatorial"):
        deputy_elements(chief, RelativeOrbitalElements(0, 0, 0, 0, 0, 0))
