"""Pairs as real receivers record them: clocks apart, other letters, F/NAV only, precise orbits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from jump_worlds import BASE, SECONDS, START, world
from sample_files import export_sample

from vtff_analysis.baseline.processing import BaselineOptions, process_baseline
from vtff_analysis.baseline.sources import BaselineError, BaselineSources, from_files, pair_times
from vtff_analysis.baseline.usage import describe_usage
from vtff_gnss import constants as c
from vtff_gnss.files.navigation_files import NavigationFiles
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_nav.relative.common.measurements import MeasurementNoise
from vtff_nav.relative.common.solution import SOLUTION_FIXED

BANDS = {c.SYSTEM_GPS: (1, 2), c.SYSTEM_GALILEO: (1, 5)}
OPTIONS = BaselineOptions(
    dynamics="static",
    bands=BANDS,
    position_base_itrf=tuple(BASE.tolist()),
    noise=MeasurementNoise(0.5, 0.002, use_receiver_sigmas=False),
)


@pytest.fixture(scope="module")
def tables():
    """Return rover and base of a baseline of 3.2 km at rest."""
    epochs = world("static").epochs
    return [ObservationTable.from_epochs([pair[i] for pair in epochs]) for i in (1, 0)]


@pytest.fixture(scope="module")
def ephemerides():
    end = START + SECONDS
    return (*nominal_gps_constellation(START, end), *nominal_galileo_constellation(START, end))


def sources_of(tables, ephemerides):
    return BaselineSources("rover", "base", *tables, tuple(ephemerides), None, False, ())


def errors_of(run):
    return np.linalg.norm(run.baseline_itrf - world("static").baseline_itrf[: len(run)], axis=1)


def with_clock(table: ObservationTable, clock: np.ndarray) -> ObservationTable:
    """Return the observations of the same instants, tagged and ranged by a clock that is off."""
    metres = np.repeat(299_792_458.0 * clock, np.diff(table.first_row))
    columns = dict(table.columns)
    columns["pseudorange"] = columns["pseudorange"] + metres
    wavelength = 299_792_458.0 / _frequency(table)
    columns["carrier_phase_cycles"] = columns["carrier_phase_cycles"] + metres / wavelength
    time = table.time_nanoseconds + np.round(clock * 1e9).astype(np.int64)
    return dataclasses.replace(table, time_nanoseconds=time, columns=columns)


def _frequency(table: ObservationTable) -> np.ndarray:
    from vtff_gnss.signals import carrier_frequency_hz

    return carrier_frequency_hz(table.columns["system"], table.columns["band"])


def test_clocks_that_are_apart_and_drift_lose_no_epoch(tables, ephemerides):
    """2 ms apart, drifting by 10 microseconds each second, tagged by their own time."""
    seconds = np.arange(SECONDS, dtype=float)
    rover = with_clock(tables[0], 2e-3 + 1e-5 * seconds)
    base = with_clock(tables[1], -4e-6 * seconds)
    run = process_baseline(sources_of((rover, base), ephemerides), OPTIONS)
    assert len(run) == SECONDS and run.unpaired == (0, 0)
    assert (run.solution == SOLUTION_FIXED)[5:].all()
    assert errors_of(run)[10:].max() < 0.01


def test_times_that_are_too_far_apart_are_not_paired(tables, ephemerides):
    rover = dataclasses.replace(tables[0], time_nanoseconds=tables[0].time_nanoseconds + 10**8)
    with pytest.raises(BaselineError, match="differ by less than 20 ms"):
        process_baseline(sources_of((rover, tables[1]), ephemerides), OPTIONS)


def test_pairs_of_fast_epochs_are_the_nearest():
    """At 100 Hz the tolerance is half a step; an epoch that is missing has no partner."""
    rover = np.arange(0, 10**9, 10**7, dtype=np.int64) + 2 * 10**6
    base = np.delete(np.arange(0, 10**9, 10**7, dtype=np.int64), 40)
    index = pair_times(rover, base)
    assert len(index[0]) == 99 and 40 not in index[0].tolist()
    assert (rover[index[0]] - base[index[1]] == 2 * 10**6).all()
    assert len(pair_times(rover[:0], base)[0]) == 0


def test_letters_that_differ_use_all_satellites(tables, ephemerides):
    """5Q and 2W of the rover with 5X and 2X of the base."""
    columns = dict(tables[1].columns)
    columns["attribute"] = np.where(columns["band"] == 1, ord("C"), ord("X")).astype(np.uint8)
    base = dataclasses.replace(tables[1], columns=columns)
    run = process_baseline(sources_of((tables[0], base), ephemerides), OPTIONS)
    same = process_baseline(sources_of(tables, ephemerides), OPTIONS)
    assert (run.satellites_used == same.satellites_used).all()
    assert (run.solution == SOLUTION_FIXED)[5:].all()
    assert run.ambiguities_fixed[-1] == same.ambiguities_fixed[-1]
    assert errors_of(run)[10:].max() < 0.01
    lines = describe_usage(tables[0], base, NavigationFiles(tuple(ephemerides)), BANDS)
    assert any(line.startswith("GPS: ") and "L2 (W with X)" in line for line in lines)
    assert any(line.startswith("Galileo: ") and "L5 (Q with X)" in line for line in lines)


def test_fnav_alone_is_used(tables, ephemerides):
    fnav = [
        dataclasses.replace(
            e, source=c.EPHEMERIS_SOURCE_FNAV, af0=e.af0 + e.group_delay - e.group_delay_secondary
        )
        if e.system == c.SYSTEM_GALILEO
        else e
        for e in ephemerides
    ]
    run = process_baseline(sources_of(tables, fnav), OPTIONS)
    same = process_baseline(sources_of(tables, ephemerides), OPTIONS)
    assert (run.satellites_used == same.satellites_used).all()
    assert errors_of(run)[10:].max() < 0.01


def test_what_is_not_used_is_told(tables, ephemerides):
    gps = NavigationFiles(tuple(e for e in ephemerides if e.system == c.SYSTEM_GPS and e.prn != 5))
    lines = describe_usage(*tables, gps, {c.SYSTEM_GPS: (1, 2), c.SYSTEM_GALILEO: (1, 5)})
    assert "Galileo: not used, no orbits" in lines
    lines = describe_usage(*tables, gps, {c.SYSTEM_GPS: (1,)})
    assert "Galileo: not used, it is not among the signals of the filter" in lines
    rover = tables[0].select(systems="G")
    lines = describe_usage(rover, tables[1], gps, BANDS)
    assert "Galileo: not used, the rover does not observe it" in lines


def test_files_tell_their_usage(tmp_path):
    sample = export_sample(tmp_path)
    sources = from_files(sample.rover, sample.base, [sample.navigation])
    assert any(line.startswith("GPS: ") and "satellites" in line for line in sources.usage)
