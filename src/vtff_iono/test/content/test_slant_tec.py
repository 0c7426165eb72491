"""Absolute slant TEC: levelling, one sigma, reasons, online against offline."""

import math

import numpy as np
import pytest
from link_simulation import START, observations, pieces

from vtff_gnss import constants as c
from vtff_iono.content.slant_tec import ArcLevels, Rejection, SlantTecProcessor, SlantTecSettings
from vtff_iono.links.signal_pairs import PairSelector, SignalPair

FACTOR = 9.51775
TWO = ((1, "C"), (2, "W"))


def elevations(time, columns, rate=0.0):
    base = np.radians(20.0 + 10.0 * (columns["prn"] - 1.0))
    return base + rate * 1e-9 * (time - time[0])


def test_content_is_found_with_its_sigma():
    """Twelve arcs of 10 minutes at 20 Hz, 0.3 m code: the error is inside the stated sigma."""
    seconds = np.arange(12000) * 0.05
    content = 30.0 + 0.01 * seconds[:, None] + 5.0 * np.sin(seconds[:, None] / 60 + np.arange(6))
    time, columns = observations(seconds, content, seed=1)
    processor = SlantTecProcessor()
    rows = processor.update(time, columns, elevations(time, columns))
    error = (rows.stec_tecu - content.ravel()).reshape(content.shape)
    sigma = rows.stec_sigma_tecu.reshape(content.shape)
    assert (rows.rejected == 0).all()
    assert np.abs(error[-1]).max() < 0.15
    ratio = error[::500] / sigma[::500]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.45)
    # Within an arc the phase noise is what remains: 1 mm on each carrier, differenced.
    whole = ArcLevels(rows)
    residual = (whole.stec_tecu - content.ravel()).reshape(content.shape)
    assert residual.std(axis=0) == pytest.approx(FACTOR * math.sqrt(2) * 1e-3, rel=0.05)


def test_satellite_and_receiver_biases_are_removed_with_their_sign():
    content = np.full((200, 3), 25.0)
    bias = np.array([-3.0, 0.5, 4.0])
    # P_second - P_first contains -c DSB.
    time, columns = observations(np.arange(200.0), content, bias_second=bias, code_sigma=1e-3)

    def satellite_bias(link, when):
        return -float(bias[link.prn - 1] - 1.0) / 299_792_458.0, 1e-10

    def receiver_bias(link, when):
        assert (link.code_first, link.code_second) == ("C1C", "C2W")
        return -1.0 / 299_792_458.0, 2e-10

    processor = SlantTecProcessor(satellite_bias, receiver_bias)
    rows = processor.update(time, columns, elevations(time, columns))
    assert rows.stec_tecu == pytest.approx(25.0, abs=0.2)
    assert rows.stec_code_tecu == pytest.approx(25.0, abs=0.2)
    assert rows.stec_sigma_tecu.min() > math.hypot(0.1, 0.2) * 2.853


def test_every_rejected_sample_has_its_reason():
    content = np.full((50, 4), 20.0)
    time, columns = observations(np.arange(50.0), content)
    elevation = elevations(time, columns)
    prn, band = columns["prn"], columns["band"]
    elevation[prn == 1] = math.radians(5.0)
    columns["cn0_dbhz"][(prn == 2) & (band == 2)] = 15.0
    columns["flags"][(prn == 3) & (band == 1)] &= ~np.uint16(c.FLAG_PARITY_KNOWN)
    elevation[prn == 4] = np.nan
    kept = ~((prn == 4) & (band == 2) & (time > time[200]))
    columns = {name: column[kept] for name, column in columns.items()}

    def bias(link, when):
        return (math.nan, math.nan) if link.prn == 2 else (0.0, 0.0)

    processor = SlantTecProcessor(bias, lambda link, when: (math.nan, math.nan))
    rows = processor.update(time[kept], columns, elevation[kept])
    reasons = {
        prn: Rejection(
            int(np.bitwise_or.reduce(rows.rejected[columns["prn"][rows.pairs.row_first] == prn]))
        )
        for prn in (1, 2, 3, 4)
    }
    assert Rejection.LOW_ELEVATION in reasons[1]
    assert Rejection.LOW_CN0 in reasons[2] and Rejection.NO_SATELLITE_BIAS in reasons[2]
    assert Rejection.PARITY_UNKNOWN in reasons[3]
    assert Rejection.NO_GEOMETRY in reasons[4] and Rejection.NO_SECOND_SIGNAL in reasons[4]
    assert (rows.rejected != 0).all()
    for prn in (1, 2, 3):
        assert Rejection.NO_RECEIVER_BIAS in reasons[prn]
        assert Rejection.NOT_LEVELLED in reasons[prn]


def test_code_outliers_do_not_level_but_a_wrong_start_is_forgotten():
    content = np.full((400, 1), 20.0)
    time, columns = observations(np.arange(400) * 0.05, content, seed=2)
    second = columns["band"] == 2
    columns["pseudorange"][second & (time == time[400])] += 30.0
    rows = SlantTecProcessor().update(time, columns, elevations(time, columns, 1e-3))
    assert rows.rejected[200] == Rejection.CODE_OUTLIER
    assert np.count_nonzero(rows.rejected) == 1
    columns["pseudorange"][second & (time <= time[2])] += 60.0
    rows = SlantTecProcessor().update(time, columns, elevations(time, columns, 1e-3))
    assert rows.stec_tecu[-1] == pytest.approx(20.0, abs=2.0)


@pytest.mark.parametrize("epochs", [1, 7, 100])
def test_online_and_offline_give_the_same_bytes(epochs):
    generator = np.random.default_rng(3)
    content = 20.0 + np.cumsum(generator.normal(0.0, 0.05, (300, 5)), axis=0)
    signals = ((1, "C"), (2, "W"), (5, "Q"))
    time, columns = observations(
        np.arange(300) * 0.05, content, signals, slips={(0, 0): (100, 3), (2, 1): (233, 1)}
    )
    elevation = elevations(time, columns, 1e-3)
    whole = SlantTecProcessor().update(time, columns, elevation)
    online = SlantTecProcessor()
    parts = [online.update(*piece) for piece in pieces(time, columns, elevation, epochs)]
    for name in ("stec_tecu", "stec_sigma_tecu", "stec_code_tecu", "arc", "rejected"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(getattr(whole, name), joined, equal_nan=True), name


def test_pairs_take_the_best_attribute():
    content = np.full((3, 2), 20.0)
    time, columns = observations(np.arange(3.0), content, ((1, "C"), (2, "X"), (2, "W")))
    selector = PairSelector()
    rows = selector.rows(time, columns)
    assert [link.code_second for link in selector.links] == ["C2W", "C2W"]
    assert len(rows) == 6
    selector = PairSelector([SignalPair(c.SYSTEM_GPS, 1, 2, "C", "X")])
    selector.rows(time, columns)
    assert [link.code_second for link in selector.links] == ["C2X", "C2X"]
    empty = {name: column[:0] for name, column in columns.items()}
    assert len(selector.rows(time[:0], empty)) == 0


def test_a_glonass_channel_that_nobody_told():
    time, columns = observations(np.arange(3.0), np.full((3, 1), 20.0), ((1, "C"), (2, "C")))
    columns["system"][:] = c.SYSTEM_GLONASS
    columns["glonass_channel"][:] = c.GLONASS_CHANNEL_UNKNOWN
    rows = SlantTecProcessor().update(time, columns, elevations(time, columns))
    assert (rows.rejected != 0).all() and np.isnan(rows.stec_tecu).all()


def test_settings_are_used():
    time, columns = observations(np.arange(20.0), np.full((20, 1), 20.0))
    settings = SlantTecSettings(elevation_mask=math.radians(30.0))
    rows = SlantTecProcessor(settings=settings).update(time, columns, elevations(time, columns))
    assert (rows.rejected & Rejection.LOW_ELEVATION).all()


def test_a_satellite_bias_that_becomes_known_within_an_arc():
    """As with an ephemeris that comes late: from then on the contents are those of the bias."""
    content = np.full((200, 2), 25.0)
    bias = np.array([-3.0, 4.0])
    time, columns = observations(np.arange(200.0), content, bias_second=bias, code_sigma=1e-3)
    is_known = False

    def satellite_bias(link, when):
        if not is_known:
            return math.nan, math.nan
        return -float(bias[link.prn - 1]) / 299_792_458.0, 1e-10

    late = SlantTecProcessor(satellite_bias)
    parts = []
    for number, part in enumerate(pieces(time, columns, elevations(time, columns), 50)):
        is_known = number >= 2
        parts.append(late.update(*part))
    before, after = parts[:2], parts[2:]
    for rows in before:
        assert (rows.rejected == Rejection.NO_SATELLITE_BIAS).all()
    for rows in after:
        assert (rows.rejected == 0).all()
        assert (rows.arc == 1).all()
        assert rows.stec_tecu == pytest.approx(25.0, abs=0.05)
    whole = SlantTecProcessor(satellite_bias).update(time, columns, elevations(time, columns))
    assert np.array_equal(parts[-1].stec_tecu, whole.stec_tecu[-len(parts[-1]) :])


def level_by_hand(difference, weight, sigma):
    """Return level and sigma of an arc from all its samples of code minus phase at once."""
    mean = np.average(difference, weights=weight)
    squares = np.sum(weight * (difference - mean) ** 2)
    per_weight = (20.0 * sigma**2 + squares) / (20.0 + len(difference))
    return mean, math.sqrt(per_weight / weight.sum())


def test_level_and_sigma_are_those_of_weighted_means():
    """Weights are the squares of the sine of elevation; the assumed noise counts as 20 samples."""
    time, columns = observations(np.arange(50.0), np.full((50, 1), 20.0), seed=5)
    elevation = elevations(time, columns, 5e-3)
    rows = SlantTecProcessor().update(time, columns, elevation)
    difference = rows.stec_code_tecu - rows.stec_phase_tecu
    weight = np.sin(elevation[::2]) ** 2
    sigma = math.sqrt(2.0) * 0.3 * FACTOR
    phase_sigma = math.sqrt(2.0) * 0.001 * FACTOR
    for last in (0, 1, 7, 30):
        level, level_sigma = level_by_hand(difference[: last + 1], weight[: last + 1], sigma)
        assert rows.stec_tecu[last] - rows.stec_phase_tecu[last] == pytest.approx(level, abs=1e-6)
        expected = math.hypot(level_sigma, phase_sigma)
        assert rows.stec_sigma_tecu[last] == pytest.approx(expected, rel=1e-4)


def test_scatter_of_minutes_is_in_the_sigma():
    """Multipath of a period of minutes: the means of whole minutes scatter more than samples."""
    seconds = np.arange(600.0)
    time, columns = observations(seconds, np.full((600, 1), 20.0), code_sigma=0.01, seed=6)
    second = columns["band"] == 2
    columns["pseudorange"][second] += np.sin(2.0 * np.pi * seconds / 400.0)
    elevation = np.full(len(time), 1.0)
    rows = SlantTecProcessor().update(time, columns, elevation)
    difference = rows.stec_code_tecu - rows.stec_phase_tecu
    minute = rows.pairs.time // 60_000_000_000
    phase_sigma = math.sqrt(2.0) * 0.001 * FACTOR
    for last in (400, 599):
        # The minute that is not over yet does not count.
        means = [
            difference[: last + 1][minute[: last + 1] == number].mean()
            for number in np.unique(minute[: last + 1])[:-1]
        ]
        expected = np.std(means, ddof=1) / math.sqrt(len(means))
        assert rows.stec_sigma_tecu[last] == pytest.approx(math.hypot(expected, phase_sigma))


def test_single_samples_count_before_the_fourth_minute():
    seconds = -(START // 10**9) % 60 + np.arange(300.0)
    time, columns = observations(seconds, np.full((300, 1), 20.0), code_sigma=0.01, seed=6)
    columns["pseudorange"][columns["band"] == 2] += np.sin(2.0 * np.pi * seconds / 400.0)
    rows = SlantTecProcessor().update(time, columns, np.full(len(time), 1.0))
    # The fourth minute ends with the sample at 240 s.
    assert rows.stec_sigma_tecu[240] > 2.0 * rows.stec_sigma_tecu[239]


def test_the_limit_of_an_outlier():
    """Five sigmas of a sample about the level, both with the assumed noise of 20 samples."""
    sigma = math.sqrt(2.0) * 0.3 * FACTOR
    for factor, is_outlier in ((0.999, False), (1.001, True)):
        time, columns = observations(np.arange(30.0), np.full((30, 1), 20.0), code_sigma=0.0)
        elevation = np.full(len(time), 0.8)
        weight = math.sin(0.8) ** 2
        per_weight = 20.0 * sigma**2 / (20.0 + 25.0)
        limit = 5.0 * math.sqrt(per_weight / weight + per_weight / (25.0 * weight))
        columns["pseudorange"][2 * 25 + 1] += factor * limit / FACTOR
        rows = SlantTecProcessor().update(time, columns, elevation)
        assert (rows.rejected[25] == Rejection.CODE_OUTLIER) == is_outlier


def test_eleven_outliers_in_a_row_begin_the_level_anew():
    """Codes that leave the wide lane as it is, so that the arc goes on."""
    for count, is_new in ((10, False), (11, True)):
        time, columns = observations(np.arange(60.0), np.full((60, 1), 20.0), code_sigma=0.0)
        second = np.flatnonzero(columns["band"] == 2)
        columns["pseudorange"][second[40 : 40 + count]] += 30.0
        columns["pseudorange"][second[40 : 40 + count] - 1] -= 30.0 * 1227.60 / 1575.42
        rows = SlantTecProcessor().update(time, columns, np.full(len(time), 1.0))
        assert (rows.arc == 1).all()
        level = rows.stec_tecu - 20.0
        assert np.abs(level[:50]).max() < 0.5
        assert (abs(level[50]) > 200.0) == is_new
        outliers = np.count_nonzero(rows.rejected & Rejection.CODE_OUTLIER)
        assert outliers >= 10


def test_limits_of_elevation_and_power():
    for elevation_deg, cn0_dbhz, reason in (
        (10.1, 20.1, 0),
        (9.9, 20.1, Rejection.LOW_ELEVATION),
        (10.1, 19.9, Rejection.LOW_CN0),
    ):
        time, columns = observations(np.arange(3.0), np.full((3, 1), 20.0))
        columns["cn0_dbhz"][columns["band"] == 1] = cn0_dbhz
        rows = SlantTecProcessor().update(
            time, columns, np.full(len(time), math.radians(elevation_deg))
        )
        expected = reason | (Rejection.NOT_LEVELLED if reason else 0)
        assert (rows.rejected == expected).all()


def test_biases_are_looked_up_once_an_hour():
    """Also a bias that changes at the hour, and one that is looked up again while unknown."""
    start = 3600 - (START // 10**9) % 3600 - 5
    time, columns = observations(start + np.arange(10.0), np.full((10, 1), 25.0))
    asked = []

    def satellite_bias(link, when):
        asked.append(when.nanoseconds)
        return (1e-9, 2e-10) if len(asked) == 1 else (3e-9, 4e-10)

    processor = SlantTecProcessor(satellite_bias)
    parts = [processor.update(*part) for part in pieces(time, columns, np.ones(len(time)), 1)]
    biases = [part.satellite_bias_tecu[0] for part in parts]
    scale = 299_792_458.0 * FACTOR
    assert biases == pytest.approx([scale * 1e-9] * 5 + [scale * 3e-9] * 5, rel=1e-5)
    sigmas = [part.satellite_bias_sigma_tecu[0] for part in parts]
    assert sigmas == pytest.approx([scale * 2e-10] * 5 + [scale * 4e-10] * 5, rel=1e-5)
    assert len(asked) == 2
    assert [when % (3600 * 10**9) for when in asked] == [0, 0]
    assert asked[1] - asked[0] == 3600 * 10**9
    # In one call the numbers are the same.
    asked.clear()
    whole = SlantTecProcessor(satellite_bias).update(time, columns, np.ones(len(time)))
    assert whole.satellite_bias_tecu.tolist() == biases


def test_arcs_without_a_level_have_no_content():
    """Levels at the end of the arcs: an arc whose samples are all too low has none."""
    time, columns = observations(np.arange(40.0), np.full((40, 2), 20.0), seed=7)
    elevation = np.where(columns["prn"] == 1, 1.0, math.radians(5.0))
    rows = SlantTecProcessor().update(time, columns, elevation)
    levels = ArcLevels(rows)
    is_high = rows.elevation > 0.5
    assert np.isnan(levels.stec_tecu[~is_high]).all()
    assert np.isnan(levels.stec_sigma_tecu[~is_high]).all()
    level = rows.stec_tecu[is_high][-1] - rows.stec_phase_tecu[is_high][-1]
    assert levels.stec_tecu[is_high] == pytest.approx(rows.stec_phase_tecu[is_high] + level)
    assert levels.stec_sigma_tecu[is_high] == pytest.approx(rows.stec_sigma_tecu[is_high][-1])
