"""Rows of the measurement model against differences of what it predicts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cdgps_test_support import START

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.model import Sky, make_sky, measurement_innovation
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.measurements import Geometry, SingleDifferences

COUNT = 6
KEYS = [SignalKey(0, prn, 1, ord("C")) for prn in range(1, COUNT + 1)]
GROWTH = np.linspace(1.0, 3.0, COUNT)
LABELS = [
    *(("motion", axis) for axis in range(9)),
    ("troposphere",),
    *(("ambiguity", key) for key in KEYS),
    *(("phase_error", key) for key in KEYS),
]


def differences() -> SingleDifferences:
    return SingleDifferences(
        keys=KEYS,
        satellite=np.arange(COUNT),
        wavelength=np.full(COUNT, 0.19),
        frequency_hz=np.full(COUNT, 1575.42e6),
        code=np.zeros(COUNT),
        phase=np.zeros(COUNT),
        code_variance=np.full(COUNT, 0.09),
        phase_variance=np.full(COUNT, 4e-6),
        is_parity_known=np.ones(COUNT, dtype=bool),
        half_cycles=np.zeros(COUNT, dtype=np.int64),
        is_lock_lost=np.zeros(COUNT, dtype=bool),
        lock_time=np.zeros((2, COUNT)),
        noise_growth=GROWTH,
    )


def sky_of(distance: float, height: float) -> tuple[Sky, np.ndarray]:
    """Return the sky of a rover so far to the side and so high, and the elevations."""
    generator = np.random.default_rng(2)
    base = itrf_from_geodetic((0.8, 0.2, 100.0))
    up = base / np.linalg.norm(base)
    side = np.cross(up, [0.0, 0.0, 1.0])
    rover = base + distance * side / np.linalg.norm(side) + height * up
    elevation = np.tile(np.radians(np.linspace(10.0, 85.0, COUNT)), (2, 1))
    direction = generator.standard_normal((2, COUNT, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    empty = np.zeros((2, COUNT))
    seen = Geometry(np.arange(COUNT), empty + 2e7, empty, empty, empty, direction, elevation, empty)
    positions = np.array([base, rover])
    configuration = CdgpsConfiguration(dynamics="static")
    return make_sky(differences(), seen, positions, positions, configuration), elevation[1]


def test_every_row_is_the_derivative_of_its_prediction():
    measured, (sky, _) = differences(), sky_of(3e3, 20.0)
    generator = np.random.default_rng(3)
    mean = generator.standard_normal(len(LABELS))
    arcs = ArcBook()
    for row in range(COUNT):
        arcs.start(START, measured, row, 0.0)

    def innovation(change: np.ndarray):
        state = GaussianState(LABELS, mean + change, np.eye(len(LABELS)))
        return measurement_innovation(state, arcs, measured, sky, 0.0)

    before = innovation(np.zeros(len(LABELS)))
    for column, label in enumerate(LABELS):
        if label[0] == "motion":
            continue
        moved = innovation(np.eye(len(LABELS))[column])
        np.testing.assert_allclose(
            before.values - moved.values, before.design[:, column], atol=1e-9, err_msg=str(label)
        )
    slow = [LABELS.index(("phase_error", key)) for key in KEYS]
    np.testing.assert_allclose(np.diagonal(before.design[COUNT:, slow]), GROWTH)


@pytest.mark.parametrize(
    ("distance", "height", "zenith"),
    [(2000.0, 0.0, 2e-3), (0.0, 40.0, 2e-3), (2000.0, 40.0, math.sqrt(8.0) * 1e-3)],
)
def test_troposphere_that_the_model_leaves(distance, height, zenith):
    """One millimetre for each kilometre, and 2 mm for 40 m of height."""
    sky, elevation = sky_of(distance, height)
    assert sky.troposphere[-1] * math.sin(elevation[-1]) == pytest.approx(zenith, rel=0.01)
    assert 5.4 < sky.troposphere[0] / zenith < 5.8
