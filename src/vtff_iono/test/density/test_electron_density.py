"""Electron density from two spacecraft, against the true density averaged over the separation."""

import copy
import functools
import math

import numpy as np
import pytest
from formation_simulation import (
    NOISE_ONE_SECOND,
    RADIUS,
    chapman,
    fly,
    mean_density,
    plumex_like,
)
from link_simulation import START

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_iono.bias.running_profile import RunningProfile
from vtff_iono.density.density_profile import (
    DEPARTURE_LEVEL_DB,
    binned_profile,
    deconvolved_profile,
    departure_scale,
    model_profile,
    wavenumber_spectrum,
)
from vtff_iono.density.differential_tec import SecondAverage, differential_stec, horizontal_sigma
from vtff_iono.density.electron_density import ElectronDensityEstimator
from vtff_iono.density.filter.settings import DensitySettings
from vtff_iono.geometry.mapping import profile_content

CM3 = 1e6
BIAS = 3.7


def without_layer():
    """Return an estimator that knows of no plasma above the spacecraft."""
    profile = RunningProfile()
    profile.resize(1e-6)
    return ElectronDensityEstimator(DensitySettings(mapping_sigma=0.1), profile)


@functools.lru_cache(maxsize=2)
def flight(offset):
    """Half a revolution over the synthetic PLUMEX-like profile, an epoch each 2 s."""
    profile = plumex_like(step=400.0)
    return profile, fly(profile, offset, step=2.0)


def estimated(estimator, flown, observed, vtec_tecu, vtec_sigma_tecu):
    """Epochs of an estimator over a flight; `vtec_tecu` holds the absolute content of each."""
    return [
        estimator.update(
            flown.time[k],
            flown.altitude_chief[k],
            flown.altitude_deputy[k],
            flown.elevation_chief[k],
            flown.elevation_deputy[k],
            observed[k],
            np.full(observed.shape[1], NOISE_ONE_SECOND),
            vtec_tecu[k],
            vtec_sigma_tecu,
        )
        for k in range(len(flown.time))
    ]


def retrieved(offset, vtec_error=0.5, seed=3, bias=BIAS):
    """Densities from noisy differences; the absolute content is wrong by 0.5 TECU."""
    profile, flown = flight(offset)
    noise = NOISE_ONE_SECOND * np.random.default_rng(seed).standard_normal(flown.stec_chief.shape)
    observed = flown.stec_deputy - flown.stec_chief + bias + noise
    vtec_tecu = flown.vtec_chief + vtec_error
    epochs = estimated(ElectronDensityEstimator(), flown, observed, vtec_tecu, 0.5)
    low = np.minimum(flown.altitude_chief, flown.altitude_deputy)
    truth = mean_density(*profile, low, low + abs(offset))
    return epochs, truth


@pytest.mark.parametrize("offset", [1000.0, -1000.0])
def test_plumex_like_profile_at_1_km(offset):
    """Bound of the project: 2e4 cm-3 from 236 to 567 km and in each bubble (paper: 6.56e4)."""
    epochs, truth = retrieved(offset)
    altitude = np.array([epoch.altitude for epoch in epochs])
    density = np.array([epoch.density for epoch in epochs])
    sigma = np.array([epoch.sigma for epoch in epochs])
    inside = (altitude >= 236e3) & (altitude < 567e3)
    error = binned_profile(altitude[inside], (density - truth)[inside], sigma[inside])
    for low, high in ((236e3, 567e3), (480e3, 520e3), (395e3, 435e3), (340e3, 380e3)):
        part = (error.altitude >= low) & (error.altitude < high)
        assert np.count_nonzero(part) > 20
        assert np.abs(error.density[part]).mean() <= 2e4 * CM3
    # The stated sigma is that of the error.
    ratio = (density - truth)[inside] / sigma[inside]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.35)
    assert epochs[-1].bias_tecu == pytest.approx(BIAS, abs=0.002)


@pytest.mark.parametrize(
    ("peak", "scale_below", "scale"), [(378e3, 35e3, 55e3), (345e3, 60e3, 85e3)]
)
def test_what_is_above_may_have_another_shape_than_the_model(peak, scale_below, scale):
    """Rising from the perigee, nothing above was measured before."""
    altitude = np.arange(100e3, 2000e3, 400.0)
    profile = altitude, chapman(altitude, 1e12, peak, scale, scale_below)
    ratios, errors = [], []
    for shape_sigma in (DensitySettings().shape_sigma, 1e-6):
        estimator = ElectronDensityEstimator(DensitySettings(shape_sigma=shape_sigma))
        flown = fly(profile, -1000.0, start=2750.0, end=3750.0, step=5.0)
        noise = np.random.default_rng(1).standard_normal(flown.stec_chief.shape)
        observed = flown.stec_deputy - flown.stec_chief + BIAS + NOISE_ONE_SECOND * noise
        epochs = estimated(estimator, flown, observed, flown.vtec_chief, 0.5)
        truth = mean_density(*profile, flown.altitude_deputy, flown.altitude_chief)
        error = np.array([epoch.density for epoch in epochs]) - truth
        sigma = np.array([epoch.sigma for epoch in epochs])
        ratios.append(math.sqrt(np.mean((error / sigma)[20:] ** 2)))
        errors.append(math.sqrt(np.mean(error[20:] ** 2)))
    assert ratios[0] < 1.3
    assert errors[0] < 0.7 * errors[1]


@pytest.mark.parametrize("factor", [0.1, 3.0])
@pytest.mark.parametrize("vtec_error", [None, 5.0])
def test_a_layer_of_another_size_with_absolute_contents_that_err(factor, vtec_error):
    """The layer is not the one supposed; an absolute content comes late, 5 TECU off and told so."""
    altitude = np.arange(100e3, 2000e3, 400.0)
    profile = altitude, chapman(altitude, factor * 1e12, 378e3, 50e3, 60e3)
    flown = fly(profile, -1000.0, start=2750.0, end=4250.0, step=5.0)
    noise = np.random.default_rng(1).standard_normal(flown.stec_chief.shape)
    observed = flown.stec_deputy - flown.stec_chief + BIAS + NOISE_ONE_SECOND * noise
    told = np.full(len(flown.time), math.nan)
    if vtec_error is not None:
        is_late = flown.time - flown.time[0] > 600.0
        told[is_late] = flown.vtec_chief[is_late] + vtec_error
    epochs = estimated(ElectronDensityEstimator(), flown, observed, told, 5.0)
    truth = mean_density(*profile, flown.altitude_deputy, flown.altitude_chief)
    error = np.array([epoch.density for epoch in epochs]) - truth
    sigma = np.array([epoch.sigma for epoch in epochs])
    assert math.sqrt(np.mean((error / sigma)[20:] ** 2)) < 1.3
    assert np.abs(error[20:]).mean() <= 2e4 * CM3


def test_what_was_measured_first_is_corrected_when_the_constant_is_known():
    """Falling; multipath of 0.03 TECU lets the first densities err together by more than later."""
    altitude = np.arange(100e3, 2000e3, 400.0)
    profile = altitude, chapman(altitude, 9e11, 378e3, 55e3, 35e3)
    flown = fly(profile, -1000.0, satellites=36, start=600.0, end=1700.0, step=10.0)
    low, high = flown.altitude_deputy, flown.altitude_chief
    truth = mean_density(*profile, low, high)[:15]
    decay, shape = math.exp(-0.1), flown.stec_chief.shape
    first, corrected = [], []
    for seed in range(6):
        generator = np.random.default_rng(seed)
        observed = flown.stec_deputy - flown.stec_chief + BIAS
        observed += NOISE_ONE_SECOND * generator.standard_normal(shape)
        slow = generator.standard_normal(shape[1])
        for row in range(len(observed)):
            observed[row] += 0.03 * slow
            drawn = generator.standard_normal(shape[1])
            slow = decay * slow + math.sqrt(1.0 - decay**2) * drawn
        estimator, nothing = ElectronDensityEstimator(), np.full(len(observed), math.nan)
        epochs = estimated(estimator, flown, observed, nothing, 1.0)[:15]
        first.append([epoch.density for epoch in epochs] - truth)
        between = zip(low[:15], high[:15], strict=True)
        corrected.append([estimator.profile.mean_density(*pair) for pair in between] - truth)
    sizes = [math.sqrt(np.mean(np.square(errors))) for errors in (first, corrected)]
    assert sizes[1] < 0.45 * sizes[0]


def test_an_absolute_content_of_unknown_error_tells_nothing():
    profile, flown = flight(1000.0)
    observed = flown.stec_deputy - flown.stec_chief + BIAS
    densities = []
    for told, sigma in ((flown.vtec_chief, math.inf), (np.full(len(flown.time), math.nan), 1.0)):
        epochs = estimated(ElectronDensityEstimator(), flown, observed, told, sigma)
        densities.append([epoch.density for epoch in epochs])
    assert np.isfinite(densities[0][10:]).all()
    assert densities[0] == densities[1]


def test_single_satellites_agree_with_all():
    epochs, truth = retrieved(1000.0)
    single = np.array([epoch.density_satellite for epoch in epochs])
    sigma = np.array([epoch.sigma_satellite for epoch in epochs])
    good = np.isfinite(single)
    assert np.isnan(single).any() and good.any()
    ratio = ((single - truth[:, None]) / sigma)[good]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.3)
    combined = np.array([epoch.sigma for epoch in epochs])
    # At first the common constant is not known apart from the density.
    assert (combined <= np.nanmin(sigma, axis=1))[50:].all()


def test_a_density_is_never_far_below_zero():
    """Empty space: the density pulled to zero holds the bias."""
    estimator = without_layer()
    generator = np.random.default_rng(2)
    elevation = np.radians([15.0, 30.0, 45.0, 60.0, 80.0])
    for second in range(300):
        epoch = estimator.update(
            second,
            600e3,
            601e3,
            elevation,
            elevation,
            2.0 + 0.0043 * generator.standard_normal(5),
            np.full(5, 0.0043),
        )
        assert epoch.density > -3.0 * epoch.sigma
    assert epoch.bias_tecu == pytest.approx(2.0, abs=0.002)


def test_no_estimate_without_separation_or_satellites():
    estimator = ElectronDensityEstimator()
    angle = np.array([0.5])
    for altitude, observed in ((400e3, 1.0), (401e3, math.nan)):
        epoch = estimator.update(
            0.0, 400e3, altitude, angle, angle, np.array([observed]), np.array([0.004])
        )
        assert math.isnan(epoch.density) and np.isnan(epoch.density_satellite).all()


def test_running_profile_knows_what_was_measured():
    profile = RunningProfile()
    profile.resize(25.0 / profile.content_above(300e3))
    assert profile.content_above(300e3) == pytest.approx(25.0, rel=1e-6)
    for middle in np.arange(500e3, 300e3, -300.0):
        density = float(chapman(middle))
        profile.absorb(middle - 500.0, middle + 500.0, density, 1e9)
    assert profile.mean_density(380e3, 381e3) == pytest.approx(float(chapman(380.5e3)), rel=0.01)
    profile.resize(1.5)
    assert profile.mean_density(380e3, 381e3) == pytest.approx(float(chapman(380.5e3)), rel=0.01)


def test_differential_content_of_fixed_integers():
    """A content that delays L1 and L2 by known cycles, with integers of millions."""
    f1, f2, light = 1575.42e6, 1227.60e6, 299_792_458.0
    content = np.array([-0.5, 0.0, 0.25])
    delay = 40.308193e16 * content
    first = 12345.6 * f1 / light - delay / f1 / light + 5_000_000
    second = 12345.6 * f2 / light - delay / f2 / light - 3_000_000
    result = differential_stec(first, second, 5_000_000, -3_000_000, f1, f2)
    assert result == pytest.approx(content, abs=1e-6)


def test_gradients_count_over_the_horizontal_distance():
    """A degree of latitude 60 deg east, and the same with a kilometre of altitude."""
    chief = itrf_from_geodetic([0.0, math.radians(60.0), 400e3])
    for height in (400e3, 399e3):
        deputy = itrf_from_geodetic([math.radians(1.0), math.radians(60.0), height])
        arc = math.radians(1.0) * 6.74e6
        for gradient, expected in (([0.0, 1e-6], 1e-6 * arc), ([1e-6, 0.0], 0.0)):
            sigma = horizontal_sigma(np.array(gradient), chief, deputy)
            assert sigma == pytest.approx(expected, rel=0.01, abs=1e-9)


def test_one_second_of_20_hz_samples_is_good_to_5_milli_tecu():
    """Bound of the project: 0.005 TECU with 1 mm on each of the four carriers."""
    generator = np.random.default_rng(4)
    # One epoch more ends the last second.
    time = START + np.arange(20 * 500 + 1) * 50_000_000
    slope = 0.01 * 1e-9 * (time - START)
    noise = 9.51775 * 1e-3 * 2.0 * generator.standard_normal(len(time))
    average = SecondAverage()
    satellite = np.zeros(len(time), dtype=np.int64)
    columns = np.column_stack((slope + noise, slope))
    means = list(average.update(time, satellite, columns))
    assert len(means) == 500 and all(samples[0] == 20 for *_, samples in means)
    error = np.array([mean[0, 0] - mean[1, 0] for _, _, mean, _ in means])
    assert np.sqrt(np.mean(error**2)) <= 0.005
    middle = np.array([when for when, *_ in means])
    assert middle[0] == START + 0.475e9
    online = SecondAverage()
    pieces = []
    for start in range(0, len(time), 7):
        part = slice(start, start + 7)
        pieces += online.update(time[part], satellite[part], columns[part])
    assert [p.columns[0, 0] for p in pieces] == [m.columns[0, 0] for m in means]


def samples(separation, seed=1):
    """Averages over the separation each 296 m, as one second apart in the paper's orbit."""
    profile = plumex_like(step=100.0)
    middle = np.arange(236e3, 567e3, 296.0)
    low, high = middle - 0.5 * separation, middle + 0.5 * separation
    sigma = np.full(len(middle), NOISE_ONE_SECOND / math.sqrt(8.0) * 1e16 / separation)
    noise = sigma * np.random.default_rng(seed).standard_normal(len(middle))
    return profile, low, high, mean_density(*profile, low, high) + noise, sigma


@pytest.mark.parametrize("separation", [3e3, 10e3])
def test_departure_at_twice_the_offset_and_what_deconvolution_gains(separation):
    """Paper: 3 km departs below 6 km, 10 km below 20 km."""
    profile, low, high, density, sigma = samples(separation)
    deconvolved = deconvolved_profile(low, high, density, sigma)
    grid = np.arange(240e3, 562e3, 250.0)
    truth = np.interp(grid, *profile)
    wavenumber, reference = wavenumber_spectrum(grid, truth)
    raw = np.interp(grid, 0.5 * (low + high), density)
    better = np.interp(grid, deconvolved.altitude, deconvolved.density)
    scale = departure_scale(wavenumber, wavenumber_spectrum(grid, raw)[1], reference)
    assert scale == pytest.approx(2.0 * separation, rel=0.15)
    gained = departure_scale(wavenumber, wavenumber_spectrum(grid, better)[1], reference)
    assert gained < 1.4 * separation
    assert np.abs(better - truth).mean() < 0.85 * np.abs(raw - truth).mean()
    inner = (deconvolved.altitude > 240e3) & (deconvolved.altitude < 562e3)
    error = np.interp(deconvolved.altitude, *profile) - deconvolved.density
    ratio = np.sqrt(np.mean((error / deconvolved.sigma)[inner] ** 2))
    assert 0.5 < ratio < 1.6


def test_deconvolution_of_a_smooth_profile_changes_nothing():
    middle = np.arange(240e3, 560e3, 500.0)
    density = chapman(middle)
    result = deconvolved_profile(middle - 500.0, middle + 500.0, density, np.full(640, 1e9))
    inner = (result.altitude > 245e3) & (result.altitude < 555e3)
    assert result.density[inner] == pytest.approx(chapman(result.altitude[inner]), rel=0.02)
    with pytest.raises(ValueError, match="8 samples"):
        deconvolved_profile(middle[:5], middle[:5] + 1e3, density[:5], np.ones(5))


def test_departure_of_a_box_average_is_at_twice_its_length():
    """White structure averaged over 4 km: the response is sinc, -3.9 dB at 8 km."""
    generator = np.random.default_rng(5)
    altitude = np.arange(0.0, 800e3, 100.0)
    fine = generator.standard_normal(len(altitude))
    averaged = np.convolve(fine, np.full(41, 1.0 / 41.0), mode="same")
    wavenumber, reference = wavenumber_spectrum(altitude, fine)
    _, measured = wavenumber_spectrum(altitude, averaged)
    assert departure_scale(wavenumber, measured, reference) == pytest.approx(8.2e3, rel=0.1)
    assert math.isnan(departure_scale(wavenumber, reference, reference))
    assert 20.0 * math.log10(2.0 / math.pi) == pytest.approx(DEPARTURE_LEVEL_DB, abs=0.05)
    with pytest.raises(ValueError, match="even steps"):
        wavenumber_spectrum([0.0, 1.0, 2.0, 4.0, 5.0], np.ones(5))


def test_the_analysis_of_the_paper_with_75_db():
    """0.0053 TECU; 6e4 cm-3 at 1 km, and in inverse proportion to the separation."""
    altitude, density = plumex_like(step=100.0)
    errors = {}
    for separation in (100.0, 1e3, 3e3, 10e3):
        result = model_profile(altitude, density, separation)
        assert result.noise_tecu == pytest.approx(0.0053, abs=1e-4)
        errors[separation] = result.mean_absolute_error / CM3
    assert errors[1e3] == pytest.approx(6e4, rel=0.05)
    assert errors[100.0] == pytest.approx(10.0 * errors[1e3], rel=0.05)
    assert errors[100.0] > errors[1e3] > errors[3e3] > errors[10e3]


def test_the_sigma_contains_the_noise_of_the_mapping():
    """A satellite whose geometric term is large counts less, and its sigma says so."""
    chief = np.radians([20.0, 40.0, 80.0, 30.0])
    deputy = chief + np.radians([0.0, 0.0, 0.0, 0.4])
    profile = RunningProfile()
    profile.resize(20.0 / profile.content_above(400e3))
    contents = [
        profile_content(elevation, RADIUS + altitude, profile.altitude, profile.density)
        for elevation, altitude in ((chief, 400e3), (deputy, 401e3))
    ]
    geometric = contents[1] - contents[0]
    assert abs(geometric[3]) > 0.2
    sigmas = []
    for mapping_noise in (0.0, 0.05):
        settings = DensitySettings(mapping_sigma=0.1, mapping_noise=mapping_noise)
        estimator = ElectronDensityEstimator(settings, copy.deepcopy(profile))
        epoch = estimator.update(0.0, 400e3, 401e3, chief, deputy, geometric, np.full(4, 0.001))
        sigmas.append(epoch.sigma_satellite * 1e3 / 1e16 / np.sin(0.5 * (chief + deputy)))
    added = np.sqrt(sigmas[1] ** 2 - sigmas[0] ** 2)
    assert added[3] == pytest.approx(0.05 * abs(geometric[3]), rel=0.6)
    assert (added[:3] < 0.3 * added[3]).all()


def simulated(slow_sigma, slow_time, fast_sigma, seed, wrong=()):
    """Return errors, sigmas and slow sigma of densities from satellites with multipath.

    `wrong` holds pairs of satellite and second from which on it has other integers.
    """
    generator = np.random.default_rng(seed)
    elevation = np.radians([15.0, 20.0, 28.0, 35.0, 47.0, 55.0, 66.0, 80.0])
    decay = math.exp(-1.0 / slow_time)
    slow = slow_sigma * generator.standard_normal(8)
    estimator, rows, outliers = without_layer(), [], []
    for second in range(900):
        slow = decay * slow + math.sqrt(1.0 - decay**2) * slow_sigma * generator.standard_normal(8)
        true = 6e11 + 2e11 * math.sin(second / 60.0)
        observed = 1234.5 - true * 1e3 / 1e16 / np.sin(elevation) + slow
        observed += fast_sigma * generator.standard_normal(8)
        for satellite, since in wrong:
            observed[satellite] += 0.513 if second >= since else 0.0
        # A layer that is all below: no geometric term, and none in the model.
        epoch = estimator.update(
            second, 600e3, 601e3, elevation, elevation, observed, np.full(8, fast_sigma)
        )
        rows.append((epoch.density - true, epoch.sigma))
        outliers.append(epoch.is_outlier)
    return np.array(rows).T, estimator, np.array(outliers)


@pytest.mark.parametrize("slow_sigma", [0.0, 0.01, 0.03, 0.06])
def test_the_sigma_is_that_of_the_multipath_in_the_data(slow_sigma):
    ratios = []
    for seed in range(3):
        (error, sigma), estimator, outliers = simulated(slow_sigma, 100.0, 0.004, seed)
        ratios.append(np.mean((error / sigma)[60:] ** 2))
        if slow_sigma > 0.0:
            assert estimator.slow_errors.sigma == pytest.approx(slow_sigma, rel=0.35)
            assert 40.0 < estimator.slow_errors.correlation_time < 250.0
        else:
            assert estimator.slow_errors.sigma < 0.002
        # In the first minute multipath may be larger than is believed.
        assert not outliers[60:].any()
    assert 0.5 < math.sqrt(np.mean(ratios)) < 1.4


def test_a_satellite_that_leaves_its_level_is_left_out():
    (error, sigma), _, outliers = simulated(0.03, 100.0, 0.004, 7, wrong=[(2, 500), (5, 700)])
    assert outliers[500:, 2].all() and outliers[700:, 5].all()
    assert not outliers[:500].any() and not outliers[:, [0, 1, 3, 4, 6, 7]].any()
    assert np.abs(error / sigma).max() < 4.0


def test_a_fade_that_begins_is_no_density():
    """Contents leave their level by less than an integer makes, and by more than they say."""
    elevation = np.radians([15.0, 25.0, 35.0, 45.0, 60.0, 80.0])
    estimator, generator, ratios = without_layer(), np.random.default_rng(1), []
    for second in range(600):
        observed = 3.0 - 5e11 * 1e3 / 1e16 / np.sin(elevation)
        observed += 0.004 * generator.standard_normal(6)
        is_fading = second >= 100 and second % 10 == 0
        if is_fading:
            observed[second // 10 % 6] += 0.07 * (-1.0) ** (second // 60)
        epoch = estimator.update(
            second, 600e3, 601e3, elevation, elevation, observed, np.full(6, 0.004)
        )
        assert not epoch.is_outlier.any()
        if is_fading:
            ratios.append((epoch.density - 5e11) / epoch.sigma)
    assert math.sqrt(np.mean(np.square(ratios))) < 1.3


def test_a_density_that_nothing_checks_is_withheld():
    """With four satellites and three common states a wrong integer could not be told."""
    for count, is_told in ((4, False), (5, True)):
        estimator = ElectronDensityEstimator()
        elevation = np.radians(np.linspace(15.0, 80.0, count))
        for second in range(100):
            observed = 3.0 - 5e11 * 1e3 / 1e16 / np.sin(elevation)
            epoch = estimator.update(
                second, 400e3, 401e3, elevation, elevation, observed, np.full(count, 0.004), 5.0
            )
        assert math.isfinite(epoch.density) == is_told
        assert epoch.bias_sigma_tecu < 1.0


@pytest.mark.parametrize(("noise", "is_told"), [(0.1, True), (0.3, False)])
def test_satellites_whose_noise_hides_an_integer_check_nothing(noise, is_told):
    """Four of six satellites fade; the filter knows the constant to less than an integer."""
    elevation = np.radians([15.0, 20.0, 28.0, 40.0, 60.0, 80.0])
    estimator = without_layer()
    for second in range(200):
        observed = 3.0 - 5e11 * 1e3 / 1e16 / np.sin(elevation)
        sigma = np.where(np.arange(6) < 4, noise if second >= 100 else 0.004, 0.004)
        epoch = estimator.update(second, 600e3, 601e3, elevation, elevation, observed, sigma)
    assert estimator.is_bias_known
    assert math.isfinite(epoch.density) == is_told


@pytest.mark.parametrize(("chosen", "is_told"), [(0, True), (1, False)])
def test_contents_that_have_chosen_their_integers_check_nothing(chosen, is_told):
    """Three satellites go on; of one of them the integers fit because they were chosen to."""
    elevation = np.radians([15.0, 20.0, 28.0, 40.0, 60.0, 80.0])
    estimator = without_layer()
    for second in range(101):
        observed = 3.0 - 5e11 * 1e3 / 1e16 / np.sin(elevation)
        observed[3:] = math.nan if second == 100 else observed[3:]
        is_independent = np.arange(6) >= (chosen if second == 100 else 0)
        epoch = estimator.update(
            second,
            600e3,
            601e3,
            elevation,
            elevation,
            observed,
            np.full(6, 0.004),
            is_independent=is_independent,
        )
    assert math.isfinite(epoch.density) == is_told


def test_a_density_of_the_past_is_told_from_what_is_known_now():
    """It counts what slow errors may have changed by since, and nothing is learned from it."""
    elevation = np.radians([15.0, 20.0, 28.0, 40.0, 60.0, 80.0])
    estimator, generator = without_layer(), np.random.default_rng(2)

    def contents(density):
        noise = 0.004 * generator.standard_normal(6)
        return 3.0 - density * 1e3 / 1e16 / np.sin(elevation) + noise

    sigma, satellites = np.full(6, 0.004), range(6)
    for second in range(200):
        last = estimator.update(
            second, 600e3, 601e3, elevation, elevation, contents(5e11), sigma, satellite=satellites
        )

    def past(elapsed, observed):
        return estimator.past_density(
            elapsed, 600e3, 601e3, elevation, elevation, observed, sigma, satellites
        )

    ratios = []
    for _ in range(50):
        epoch = past(5.0, contents(2e11))
        ratios.append((epoch.density - 2e11) / epoch.fast_sigma)
    assert 0.5 < math.sqrt(np.mean(np.square(ratios))) < 1.5
    assert past(100.0, contents(2e11)).sigma > past(1.0, contents(2e11)).sigma
    observed = contents(2e11)
    observed[2] += 0.52
    assert past(5.0, observed).is_outlier.tolist() == [False, False, True, False, False, False]
    observed[:4] = math.nan
    assert math.isnan(past(5.0, observed).density)
    again = past(0.0, contents(5e11))
    assert again.bias_tecu == pytest.approx(last.bias_tecu, abs=3.0 * last.bias_sigma_tecu)
    assert estimator.is_bias_known


def test_nothing_is_learned_from_contents_that_nothing_checks():
    """Two satellites that agree on a wrong density, as two wrong integers may."""
    elevation = np.radians(np.linspace(15.0, 80.0, 8))
    estimator, epochs = without_layer(), []
    for second in range(200):
        observed = 3.0 - 5e11 * 1e3 / 1e16 / np.sin(elevation)
        if 100 <= second < 130:
            observed = np.where(np.arange(8) < 2, observed - 0.3 / np.sin(elevation), math.nan)
        epochs.append(
            estimator.update(
                second, 600e3, 601e3, elevation, elevation, observed, np.full(8, 0.004)
            )
        )
    densities = np.array([epoch.density for epoch in epochs])
    assert np.isnan(densities[100:130]).all()
    assert densities[130:] == pytest.approx(5e11, abs=1e10)
    assert epochs[129].bias_tecu == epochs[99].bias_tecu
    assert estimator.is_bias_known


def test_what_the_data_do_not_tell_is_withheld():
    """A single satellite cannot tell the constant from the density."""
    estimator = ElectronDensityEstimator()
    angle = np.array([0.8])
    epoch = estimator.update(0.0, 400e3, 401e3, angle, angle, np.array([5.0]), np.array([0.004]))
    assert math.isnan(epoch.density) and math.isnan(epoch.sigma)
