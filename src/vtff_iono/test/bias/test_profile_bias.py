"""Biases with a density profile: known answers, many draws of noise, gradients, a plasmasphere."""

import numpy as np
import pytest
from formation_simulation import RADIUS
from orbit_simulation import BIAS, PER_NS, PROFILES, samples, seen

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_iono.bias.bias_samples import BiasSamples
from vtff_iono.bias.expected_contents import Knots, pierce_offsets
from vtff_iono.bias.profile_bias import profile_biases
from vtff_iono.bias.receiver_bias import estimate_receiver_biases
from vtff_iono.geometry.mapping import pierce_point, profile_content

PHASE_NOISE = 0.0135
LEVEL_SIGMA, SATELLITE_SIGMA = 0.1, 0.13
# What is stated of satellites is far more than what their biases are in truth.
STATED_SATELLITE_SIGMA = 3.7


def noisy(rows, seed):
    """Return samples with errors of levels, satellites and phases drawn from `seed`."""
    generator = np.random.default_rng(1000 + seed)
    clean = samples(rows, seed, LEVEL_SIGMA)
    satellite = rows[:, 9].astype(np.int64)
    error = generator.normal(0.0, SATELLITE_SIGMA, satellite.max() + 1)[satellite]
    error += generator.normal(0.0, PHASE_NOISE, len(rows))
    return BiasSamples(
        **{
            **vars(clean),
            "stec_tecu": clean.stec_tecu + error,
            "stec_sigma_tecu": np.full(len(rows), np.hypot(LEVEL_SIGMA, STATED_SATELLITE_SIGMA)),
            "link": satellite,
            "satellite_sigma_tecu": np.full(len(rows), STATED_SATELLITE_SIGMA),
        }
    )


def estimate(rows, seed):
    (found,) = estimate_receiver_biases(noisy(rows, seed)).biases
    return found.bias_tecu - BIAS, found.sigma_tecu


def altitude_of(rows):
    return geodetic_from_itrf(rows[:, 6:9])[:, 2]


@pytest.mark.parametrize("name", ["plumex", "chapman"])
def test_errors_are_as_large_as_the_sigmas(name):
    rows = seen(name, 0.5)
    errors, sigmas = np.transpose([estimate(rows, seed) for seed in range(24)])
    assert np.abs(errors).max() <= 0.15 * PER_NS
    normalised = errors / sigmas
    assert np.mean(np.abs(normalised) <= 2.0) >= 0.9
    # Root mean square of 24 normal numbers: outside 0.65 to 1.35 once in hundreds.
    assert 0.65 < np.sqrt(np.mean(normalised**2)) < 1.35


@pytest.mark.parametrize("seed", range(3))
def test_a_plasmasphere_is_not_taken_for_a_bias(seed):
    error, sigma = estimate(seen("plasmasphere", 1.0), seed)
    assert abs(error) <= 0.15 * PER_NS
    assert abs(error) <= 2.0 * sigma


def test_few_data_have_a_large_sigma():
    rows = seen("plasmasphere", 1.0)
    early = rows[rows[:, 0] < 400.0]
    error, sigma = estimate(early, 0)
    assert abs(error) <= 2.0 * sigma
    assert sigma > estimate(rows, 0)[1]


@pytest.mark.parametrize("amplitude", [0.05, 0.2, 0.5])
def test_horizontal_gradients_are_told_from_the_bias(amplitude):
    """The ionosphere of a day: content larger by a part that changes along and across the orbit."""
    rows = seen("chapman", 1.0).copy()
    point = pierce_point(rows[:, 6:9], rows[:, 3:6], altitude_of(rows) + 200e3)
    latitude, longitude = geodetic_from_itrf(point)[:, :2].T
    errors, sigmas = [], []
    for seed in range(4):
        phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 2)
        factor = 1.0 + amplitude * 0.5 * (
            np.sin(2.0 * longitude + phase[0]) + np.sin(3.0 * latitude + phase[1])
        )
        changed = rows.copy()
        changed[:, 1] *= factor
        error, sigma = estimate(changed, seed)
        errors.append(error)
        sigmas.append(sigma)
    assert np.abs(errors).max() <= 0.15 * PER_NS
    assert np.sqrt(np.mean((np.array(errors) / sigmas) ** 2)) < 2.0


@pytest.mark.parametrize("gradient", [0.0, 0.3, 1.0])
def test_gradients_are_told_by_direction(gradient):
    """TECU per 1000 km to the north; the rays do not tell less than some 0.05."""
    rows = seen("chapman", 1.0).copy()
    altitude = altitude_of(rows)
    zenith = np.full(len(rows), 0.5 * np.pi)
    mapping = rows[:, 1] / profile_content(zenith, RADIUS + altitude, *PROFILES["chapman"])
    north = pierce_offsets(rows[:, 6:9], rows[:, 3:6], altitude)[:, 1]
    rows[:, 1] += mapping * gradient * north
    found = profile_biases(noisy(rows, 0), altitude)
    of_east, of_north = 1e6 * found.gradient_sigma
    assert of_north == pytest.approx(gradient, rel=0.15, abs=0.08)
    assert of_east < max(0.08, 0.3 * gradient)
    assert 0.0 < found.vertical_sigma_tecu < 0.2


@pytest.mark.parametrize(("shell_altitude", "largest"), [(800e3, 0.2), (1300e3, 1.5)])
def test_structure_far_above_is_told_from_levels(shell_altitude, largest):
    """A gradient of 1 TECU per 1000 km on a shell of its own, which no solution is told of.

    With the layer of the profile alone contents would err by 0.6 TECU (800 km). As far above as
    1300 km one of the models does not hold: contents err by 1.0 TECU, and their sigma says so.
    """
    rows = seen("chapman", 1.0).copy()
    altitude = altitude_of(rows)
    point = pierce_point(
        rows[:, 6:9], rows[:, 3:6], altitude + np.maximum(shell_altitude - altitude, 1e5)
    )
    cosine = np.sum(point * rows[:, 3:6], axis=1) / np.linalg.norm(point, axis=1)
    latitude = geodetic_from_itrf(point)[:, 0]
    rows[:, 1] += RADIUS * 1e-6 * latitude / cosine
    errors, ratios = [], []
    for seed in range(3):
        drawn = noisy(rows, seed)
        found = profile_biases(drawn, altitude)
        first = np.array([np.flatnonzero(drawn.arc == number)[0] for number in found.arc])
        departure = (drawn.stec_tecu - rows[:, 1])[first]
        errors.append(departure - found.offset_tecu)
        ratios.append(errors[-1] / found.offset_sigma_tecu)
    assert np.sqrt(np.mean(np.square(errors))) < largest
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_long_samples_are_solved_in_pieces():
    """Five hours are two pieces: the bias is between theirs, every arc has its better offset."""
    rows = seen("chapman", 5.0, interval=40.0)
    drawn = noisy(rows, 0)
    found = profile_biases(drawn, altitude_of(rows))
    assert (np.abs(found.bias_tecu - BIAS) < 2.0 * found.sigma_tecu).all()
    assert np.array_equal(found.arc, np.unique(drawn.arc))
    middle = 0.5 * float(np.ptp(rows[:, 0]))
    parts = [
        profile_biases(drawn.select(of_part), altitude_of(rows[of_part]))
        for of_part in (rows[:, 0] < middle, rows[:, 0] >= middle)
    ]
    low, high = np.sort([part.bias_tecu for part in parts], axis=0)
    assert (found.bias_tecu > low).all() and (found.bias_tecu < high).all()
    for arc, offset, sigma in zip(
        found.arc, found.offset_tecu, found.offset_sigma_tecu, strict=True
    ):
        known = [
            (part.offset_sigma_tecu[place], part.offset_tecu[place])
            for part in parts
            for place in np.flatnonzero(part.arc == arc)
        ]
        assert (sigma, offset) == min(known)


def test_profile_noise_and_satellites_are_found():
    rows = seen("chapman", 1.0)
    found = profile_biases(noisy(rows, 0), altitude_of(rows))
    # Neighbouring shells of 5 km may share their electrons wrongly; those of 40 km may not.
    flown = (found.altitude > 260e3) & (found.altitude < 700e3)
    true = np.interp(found.altitude, *PROFILES["chapman"])[flown]
    mean, expected = (values.reshape(-1, 8).mean(axis=1) for values in (found.density[flown], true))
    assert mean == pytest.approx(expected, rel=0.05)
    assert found.noise_tecu == pytest.approx(PHASE_NOISE, rel=0.2)
    assert found.satellite_sigma_tecu == pytest.approx(SATELLITE_SIGMA, rel=0.35)
    without = BiasSamples(**{**vars(noisy(rows, 0)), "link": None})
    assert np.isnan(profile_biases(without, altitude_of(rows)).satellite_sigma_tecu)


def test_outliers_count_little():
    rows = seen("chapman", 1.0)
    clean = noisy(rows, 0)
    stec = clean.stec_tecu.copy()
    stec[::50] += 30.0
    bad = BiasSamples(**{**vars(clean), "stec_tecu": stec})
    altitude = altitude_of(rows)
    one, other = (profile_biases(part, altitude) for part in (clean, bad))
    assert np.abs(one.bias_tecu - other.bias_tecu).max() < 0.1


@pytest.mark.parametrize("name", ["chapman", "plasmasphere"])
def test_altitude_need_hardly_change(name):
    """Contents of all elevations tell bias and layer; mapping factors would be off by a TECU."""
    rows = seen(name, 1.0, swing=2e3)
    errors, sigmas = np.transpose([estimate(rows, seed) for seed in range(8)])
    assert np.abs(errors).max() <= 0.15 * PER_NS
    assert 0.4 < np.sqrt(np.mean((errors / sigmas) ** 2)) < 1.6


def test_arcs_of_bad_codes_have_the_contents_of_the_others():
    """Levels that err by 2 TECU, 0.1 is stated: offsets are known far better, and say so."""
    rows = seen("chapman", 1.0)
    ratios = []
    for seed in range(4):
        bad = noisy(rows, seed)
        error = np.random.default_rng(seed).normal(0.0, 2.0, bad.arc.max() + 1)
        stec = bad.stec_tecu + error[bad.arc]
        bad = BiasSamples(**{**vars(bad), "stec_tecu": stec})
        found = profile_biases(bad, altitude_of(rows))
        first = [int(np.flatnonzero(bad.arc == number)[0]) for number in found.arc]
        departure = [np.mean((stec - rows[:, 1])[bad.arc == bad.arc[row]]) for row in first]
        assert np.std(departure) > 1.0
        ratios.append((departure - found.offset_tecu) / found.offset_sigma_tecu)
        assert np.sqrt(np.mean((departure - found.offset_tecu) ** 2)) < 0.03
    assert 0.3 < np.sqrt(np.mean(np.square(np.concatenate(ratios)))) < 1.5


def test_slow_waves_of_the_ionosphere_are_in_the_sigmas():
    """Waves of 0.05 TECU and 200 s, larger in low rays, where the altitude hardly changes.

    They shift levels by as much as they are. Taken for white noise with the correlation of
    neighbouring residuals they made errors of 1.7 of the sigmas.
    """
    rows = seen("chapman", 1.0, swing=2e3)
    altitude = altitude_of(rows)
    satellite = rows[:, 9].astype(np.int64)
    ratios = []
    for seed in range(8):
        generator = np.random.default_rng(seed)
        wave = np.zeros(len(rows))
        for number in np.unique(satellite):
            own = np.flatnonzero(satellite == number)
            kept, value = np.exp(-np.diff(rows[own, 0]) / 200.0), generator.standard_normal()
            for row, part in zip(own, [0.0, *kept], strict=True):
                value = part * value + np.sqrt(1.0 - part**2) * generator.standard_normal()
                wave[row] = value
        drawn = noisy(rows, seed)
        content = rows[:, 1] + 0.05 * wave / np.sin(np.maximum(rows[:, 2], 0.3))
        drawn = BiasSamples(**{**vars(drawn), "stec_tecu": drawn.stec_tecu + content - rows[:, 1]})
        found = profile_biases(drawn, altitude)
        first = np.array([np.flatnonzero(drawn.arc == number)[0] for number in found.arc])
        departure = (noisy(rows, seed).stec_tecu - rows[:, 1])[first]
        ratios.append((departure - found.offset_tecu) / found.offset_sigma_tecu)
    assert 0.5 < np.sqrt(np.mean(np.square(np.concatenate(ratios)))) < 1.3


@pytest.mark.parametrize("part", [0.0, 1.0])
def test_wind_up_is_found_where_phases_have_it(part):
    rows = seen("chapman", 1.0)
    drawn = noisy(rows, 0)
    # Turns of 0.08 TECU in an arc of 25 minutes, one way or the other.
    rate = np.random.default_rng(3).normal(0.0, 0.08 / 1500.0, drawn.arc.max() + 1)
    turns = rate[drawn.arc] * (rows[:, 0] % 1500.0)
    stec = drawn.stec_tecu + part * turns
    drawn = BiasSamples(**{**vars(drawn), "stec_tecu": stec, "wind_up_tecu": turns})
    found = profile_biases(drawn, altitude_of(rows))
    assert found.wind_up == pytest.approx(part, abs=0.15)


def test_expected_contents_are_those_of_rays_to_come():
    rows = seen("chapman", 1.0)
    early = rows[:, 0] < 3000.0
    contents = profile_biases(noisy(rows[early], 0), altitude_of(rows[early])).contents
    later = rows[(rows[:, 0] >= 3000.0) & (rows[:, 0] < 3200.0)]
    expected, mapping = contents.contents(later[:, 0], later[:, 6:9], later[:, 3:6])
    assert expected == pytest.approx(later[:, 1], rel=0.03, abs=0.1)
    assert (mapping >= 1.0).all() and (np.argsort(mapping) == np.argsort(-later[:, 2])).mean() > 0.5


def test_arcs_are_required():
    rows = seen("chapman", 0.5)
    without = BiasSamples(**{**vars(noisy(rows, 0)), "arc": None})
    with pytest.raises(ValueError, match="arcs are required"):
        profile_biases(without, altitude_of(rows))


@pytest.mark.parametrize(
    ("duration", "knots"),
    [(0.0, 2), (300.0, 2), (301.0, 3), (3600.0, 13), (10500.0, 36), (3e4, 101)],
)
def test_weights_of_knots(duration, knots):
    """Linear in between: a knot is recovered, weights are positive and their sum is 1."""
    time = 50.0 + np.linspace(0.0, duration, 241)
    weights = Knots.over(time).weights(time)
    assert weights.shape == (241, knots)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert weights.min() >= 0.0
    if duration > 0.0:
        assert weights @ np.linspace(0.0, duration, knots) == pytest.approx(time - 50.0)
        assert (np.count_nonzero(weights > 1e-9, axis=1) <= 2).all()
