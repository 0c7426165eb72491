"""Levels of arcs by a profile: of arcs that it was solved with, and of those begun since."""

import dataclasses

import numpy as np
import pytest
from orbit_simulation import BIAS, samples, seen

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_iono.bias.bias_samples import BiasSamples
from vtff_iono.bias.profile_bias import profile_biases
from vtff_iono.spacecraft.arc_offsets import ArcContents, ArcOffsets

SOLVED = 2400.0
LEVEL_ERROR = 2.0


@pytest.fixture(scope="module")
def flight():
    """Return the rays of 200 s after a solution, and the offsets by that solution."""
    rows = seen("chapman", 1.0)
    rows = rows[rows[:, 0] < SOLVED + 200.0]
    satellite = rows[:, 9].astype(np.int64)
    later = rows[:, 0] >= SOLVED
    # A third of the satellites is tracked only since then.
    before = ~later & (satellite % 3 > 0)
    known = samples(rows[before], 0, LEVEL_ERROR)
    known = BiasSamples(**{**vars(known), "arc": satellite[before], "link": satellite[before]})
    # One level for each satellite, and no phase noise.
    error = np.random.default_rng(0).normal(0.0, LEVEL_ERROR, satellite.max() + 1)
    stec = rows[before, 1] + BIAS + error[known.arc]
    known = BiasSamples(**{**vars(known), "stec_tecu": stec})
    profile = profile_biases(known, geodetic_from_itrf(known.position_receiver_itrf)[:, 2])
    # The phases lack as much as the levels are.
    levels = [((number, 1), BIAS + float(error[number])) for number in range(len(error))]
    offsets = ArcOffsets()
    offsets.renew(profile, levels)
    return rows[later], offsets, profile, levels


def contents(rows, chosen=slice(None)):
    """Return contents whose codes are 3 TECU wrong, from phases without a constant."""
    part = rows[chosen]
    satellite = part[:, 9].astype(np.int64)
    count = len(part)
    return ArcContents(
        (part[:, 0] * 1e9).astype(np.int64),
        satellite,
        np.ones(count, dtype=np.int64),
        np.ones(count, dtype=bool),
        part[:, 1].copy(),
        np.zeros(count),
        part[:, 1] + 3.0,
        np.full(count, 2.0),
        part[:, 6:9],
        part[:, 3:6],
    )


def test_arcs_have_the_contents_of_the_profile(flight):
    rows, offsets, profile, _ = flight
    is_solved = np.isin(rows[:, 9], profile.arc)
    assert 0 < np.count_nonzero(~is_solved) < np.count_nonzero(is_solved)
    stec, sigma = offsets.improve(contents(rows))
    error = stec - rows[:, 1]
    assert np.abs(error[is_solved]).max() < 0.15
    assert np.sqrt(np.mean((error / sigma)[is_solved] ** 2)) < 2.0
    # Those that rose since: by what the others show, not by their codes.
    assert np.abs(error[~is_solved]).max() < 1.0
    assert np.sqrt(np.mean((error / sigma)[~is_solved] ** 2)) < 2.0


def test_epochs_alone_and_together_have_the_same_contents(flight):
    rows, _, profile, levels = flight
    together, alone = ArcOffsets(), ArcOffsets()
    together.renew(profile, levels)
    alone.renew(profile, levels)
    expected = together.improve(contents(rows))
    parts = [alone.improve(contents(rows, rows[:, 0] == time)) for time in np.unique(rows[:, 0])]
    assert np.array_equal(np.concatenate([part[0] for part in parts]), expected[0])
    assert np.array_equal(np.concatenate([part[1] for part in parts]), expected[1])


def test_wind_up_is_removed_as_far_as_phases_have_it(flight):
    rows, offsets, profile, levels = flight
    plain = contents(rows)
    expected, _ = offsets.improve(plain)
    turning = 0.3 * np.sin(rows[:, 0])
    for part in (0.0, 1.0):
        again = ArcOffsets()
        again.renew(dataclasses.replace(profile, wind_up=part), levels)
        phase = plain.stec_phase_tecu + part * turning
        turned = plain._replace(stec_phase_tecu=phase, wind_up_tecu=turning)
        assert again.improve(turned)[0] == pytest.approx(expected, abs=2e-3)


def test_codes_level_the_arcs_without_a_profile(flight):
    rows, _, _, _ = flight
    plain = contents(rows)
    for renewed in (False, True):
        offsets = ArcOffsets()
        if renewed:
            offsets.renew(None, [])
        stec, sigma = offsets.improve(plain)
        assert np.array_equal(stec, plain.stec_tecu)
        assert np.array_equal(sigma, plain.stec_sigma_tecu)


def test_codes_level_a_new_arc_while_few_others_are_known(flight):
    rows, offsets, profile, _ = flight
    is_solved = np.isin(rows[:, 9], profile.arc)
    first = rows[~is_solved][0]
    at = (rows[:, 0] == first[0]) & (rows[:, 9] == first[9])
    stec, _ = ArcOffsets().improve(contents(rows, at))
    fresh = ArcOffsets()
    fresh.renew(*flight[2:])
    assert np.array_equal(fresh.improve(contents(rows, at))[0], stec)
