"""Tables of a solution from the state of the relative filter."""

from __future__ import annotations

import functools
import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import DELAY_PER_TECU
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.model import Sky
from vtff_nav.relative.cdgps.state import GaussianState, Innovation
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.common.solution import (
    AMBIGUITY_FIXED,
    AmbiguityTable,
    DifferentialTecTable,
)
from vtff_nav.relative.kernels.tables import tabulate_ambiguities, tabulate_differential_tec

__all__ = ["ambiguity_table", "differential_tec_table", "relative_rtn"]


def relative_rtn(
    chief_gcrf: FloatArray,
    relative_gcrf: FloatArray,
    covariance_chief: FloatArray,
    covariance_relative: FloatArray,
    covariance_cross: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the relative state in the chief's RTN frame, shape (6,), and its covariance (6, 6).

    Parameters
    ----------
    chief_gcrf, relative_gcrf : ndarray, shape (6,)
        State of the chief, and deputy less chief, m and m/s.
    covariance_chief, covariance_relative : ndarray, shape (6, 6)
        Covariances of these states. Errors of the chief turn the frame and are part of the result.
    covariance_cross : ndarray, shape (6, 6), optional
        Covariance of the relative state (rows) with that of the chief; without it they are
        independent.
    """
    rotation = rotation_gcrf_to_rtn(chief_gcrf)
    state, from_difference, from_chief = derivatives_rtn(chief_gcrf, relative_gcrf, rotation)
    covariance = (
        from_difference @ covariance_relative @ from_difference.T
        + from_chief @ covariance_chief @ from_chief.T
    )
    if covariance_cross is not None:
        cross_rtn = from_difference @ covariance_cross @ from_chief.T
        covariance += cross_rtn + cross_rtn.T
    return state, covariance


@compiled
def derivatives_rtn(chief_gcrf, relative_gcrf, rotation):  # type: ignore[no-untyped-def]
    """Return the relative state in RTN, (6,), and its derivatives by both states in GCRF, (6, 6).

    Parameters
    ----------
    chief_gcrf, relative_gcrf : ndarray, shape (6,)
        State of the chief, and deputy less chief, m and m/s.
    rotation : ndarray, shape (3, 3)
        From GCRF to RTN. The frame turns with h/r2 about N, see `relative_state_rtn`.
    """
    x, y, z, vx, vy, vz = chief_gcrf
    square = x * x + y * y + z * z
    radius, climb = math.sqrt(square), (x * vx + y * vy + z * vz) / math.sqrt(square)
    momentum = math.sqrt((y * vz - z * vy) ** 2 + (z * vx - x * vz) ** 2 + (x * vy - y * vx) ** 2)
    rate = momentum / square
    state, from_difference = np.zeros(6), np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            state[i] += rotation[i, j] * relative_gcrf[j]
            state[3 + i] += rotation[i, j] * relative_gcrf[3 + j]
            from_difference[i, j] = from_difference[3 + i, 3 + j] = rotation[i, j]
    a, b, c = state[0], state[1], state[2]
    va, vb, vc = state[3], state[4], state[5]  # without the rotation of the frame
    state[3] += rate * b
    state[4] -= rate * a
    from_chief = np.empty((6, 6))
    for j in range(3):
        from_difference[3, j] = rate * rotation[1, j]
        from_difference[4, j] = -rate * rotation[0, j]
    for j in range(6):
        # Errors of the chief turn the frame, about R, T and N, and change its rate.
        if j < 3:
            about_r = -climb * rotation[2, j] / momentum
            about_t = -rotation[2, j] / radius
            about_n = rotation[1, j] / radius
            change = -(rate * rotation[0, j] + climb / radius * rotation[1, j]) / radius
        else:
            about_r = radius * rotation[2, j - 3] / momentum
            about_t = about_n = 0.0
            change = rotation[1, j - 3] / radius
        # In a frame turned by theta a vector appears turned by -theta.
        from_chief[0, j] = b * about_n - c * about_t
        from_chief[1, j] = c * about_r - a * about_n
        from_chief[2, j] = a * about_t - b * about_r
        from_chief[3, j] = vb * about_n - vc * about_t + rate * from_chief[1, j] + change * b
        from_chief[4, j] = vc * about_r - va * about_n - rate * from_chief[0, j] - change * a
        from_chief[5, j] = va * about_t - vb * about_r
    return state, from_difference, from_chief


def ambiguity_table(
    state: GaussianState,
    arcs: ArcBook,
    measured: SingleDifferences,
    innovation: Innovation,
    is_new: set[SignalKey],
) -> AmbiguityTable:
    """Return the ambiguities of the signals of an epoch.

    Parameters
    ----------
    state : GaussianState
    arcs : ArcBook
    measured : SingleDifferences
    innovation : Innovation
        Innovation of n codes and n phases: one epoch gives a held ambiguity to the sigma of that of
        its phase.
    is_new : set of SignalKey
        Signals whose integer was decided at this epoch.
    """
    signals, columns = measured.keys, arcs.columns(measured.keys, state)
    cycles, sigma_cycles = tabulate_ambiguities(
        state.mean,
        state.covariance,
        columns.phase_columns,
        columns.has_integer,
        columns.cycles,
        columns.reference_cycles,
        measured.wavelength,
        innovation.variances,
    )
    states = columns.states_held
    if is_new:
        states = states.copy()
        states[[signals.rows[key] for key in is_new if key in signals.rows]] = AMBIGUITY_FIXED
    system, prn, band, attribute = signals.name_columns
    return AmbiguityTable(
        system=system,
        prn=prn,
        band=band,
        attribute=attribute,
        reference_prn=columns.reference_prn,
        ambiguity_cycles=cycles,
        ambiguity_sigma_cycles=sigma_cycles,
        state=states,
        fixed_since=columns.fixed_since,
    )


def differential_tec_table(
    state: GaussianState, arcs: ArcBook, measured: SingleDifferences, sky: Sky
) -> DifferentialTecTable:
    """Return the differential slant TEC of the satellites with integers on two carriers.

    The geometry-free phase less its integers is
    ``40.3 STEC (1 / f2^2 - 1 / f1^2) + beta_1 - beta_2``; the biases come from the state.
    """
    columns = arcs.columns(measured.keys, state)
    if not len(columns.pairs):
        return DifferentialTecTable()
    frequencies = measured.frequency_hz[columns.pairs].tolist()
    stec, sigma, elevation, azimuth = tabulate_differential_tec(
        state.mean,
        state.covariance,
        columns.pairs,
        np.array([_metres_per_tecu(first, second) for first, second in frequencies]),
        columns.phase_columns,
        columns.cycles,
        measured.wavelength,
        measured.phase,
        measured.phase_variance,
        sky.elevation,
        sky.azimuth,
    )
    system, prn, band_first, band_second = columns.pair_names
    return DifferentialTecTable(
        system=system,
        prn=prn,
        band_first=band_first,
        band_second=band_second,
        stec_tecu=stec,
        stec_sigma_tecu=sigma,
        elevation=elevation,
        azimuth=azimuth,
        arc=columns.pair_numbers,
    )


@functools.lru_cache(maxsize=64)
def _metres_per_tecu(first_hz: float, second_hz: float) -> float:
    """Return what 1 TECU changes the difference of the phases of two carriers by, m."""
    return DELAY_PER_TECU * (second_hz**-2 - first_hz**-2)
