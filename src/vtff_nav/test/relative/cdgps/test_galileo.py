"""Galileo in the relative filter: alone and with GPS, on the carriers L1/E1 and L5/E5a.

Both emulated receivers track the satellites of the nominal constellations with the noise, clocks
and biases of test_emulator. The broadcast group delays of Galileo are metres on E5a.
"""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import Scenario, configuration, fly, simulate
from cdgps_truth_support import tec_errors, wrong_integers

from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_nav.relative.common.measurements import DEFAULT_BANDS
from vtff_sim_bridge.atmosphere.density_models import constant_profile

SECONDS = 180
SIGNALS = {"G1C": 48.0, "G5Q": 49.0, "E1C": 48.0, "E5Q": 49.0}
BANDS = {
    "Galileo": {SYSTEM_GALILEO: (1, 5)},
    "Galileo and GPS": dict(DEFAULT_BANDS),
}


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """Return three minutes at 250 m within plasma, with the signals of both systems."""
    return simulate(SECONDS, signals=SIGNALS, profile=constant_profile(5e11, 450e3, 800e3))


@pytest.mark.parametrize("bands", BANDS.values(), ids=BANDS)
def test_accuracy(scenario, bands):
    """Every epoch fixed, no integer wrong, and the 0.8 mm of GPS at the same density (issue 4)."""
    flight = fly(scenario, configuration(bands=bands))
    wrong = [wrong_integers(scenario.truth, k, s) for k, s in enumerate(flight.solutions)]
    print(
        f"3-D RMS {1e3 * flight.rms():.3f} mm, velocity {1e6 * flight.velocity_rms():.1f} um/s, "
        f"chief {np.linalg.norm(flight.error_chief[60:], axis=1).max():.2f} m"
    )
    assert not any(wrong)
    assert flight.is_fixed[1:].all()
    assert flight.rms() <= 0.8e-3
    assert flight.velocity_rms() <= 20e-6
    # The codes place the chief: a group delay that is wrong moves it by metres.
    assert np.linalg.norm(flight.error_chief[60:], axis=1).max() < 1.0
    last = flight.solutions[-1]
    table = last.ambiguities
    assert set(table.system.tolist()) == set(bands)
    assert set(table.band[table.system == SYSTEM_GALILEO].tolist()) == {1, 5}
    assert last.satellites_used >= 7 * len(bands)
    errors, sigmas = tec_errors(scenario.truth, SECONDS - 1, last)
    assert len(errors) == last.satellites_used
    assert np.abs(errors / sigmas).max() < 4.0


def test_systems_have_references_of_their_own(scenario):
    """GPS and Galileo share carriers, but no receiver bias: each has its reference satellites."""
    flight = fly(scenario.until(10), configuration(bands=DEFAULT_BANDS))
    table = flight.solutions[-1].ambiguities
    for system in (SYSTEM_GPS, SYSTEM_GALILEO):
        rows = table.system == system
        assert set(table.reference_prn[rows].tolist()) <= set(table.prn[rows].tolist())
