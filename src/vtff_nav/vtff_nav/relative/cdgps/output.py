"""Tables of a solution from the state of the relative filter."""

from __future__ import annotations

import functools
import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.model import Sky
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.common.solution import (
    AMBIGUITY_FIXED,
    AMBIGUITY_FLOAT,
    AMBIGUITY_HELD,
    AmbiguityTable,
    DifferentialTecTable,
)

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
    sigmas: FloatArray,
    is_new: set[SignalKey],
) -> AmbiguityTable:
    """Return the ambiguities of the signals of an epoch.

    Parameters
    ----------
    state : GaussianState
    arcs : ArcBook
    measured : SingleDifferences
    sigmas : ndarray, shape (n,)
        Sigmas of the innovations of the phases, m: one epoch gives a held ambiguity to this sigma.
    is_new : set of SignalKey
        Signals whose integer was decided at this epoch.
    """
    groups = arcs.fixed_groups()
    references = {group: members[0] for group, members in groups.items()}
    rows: list[tuple[int, float, float, int, GpsTime | None]] = []
    columns = (measured.keys, measured.wavelength.tolist(), sigmas.tolist())
    for key, wavelength, innovation_sigma in zip(*columns, strict=True):
        arc = arcs[key]
        if arc.integer is None:
            label = ("ambiguity", key)
            value = state.value(label) / wavelength + arc.offset_cycles
            sigma = state.sigma(label) / wavelength
            rows.append((0, value, sigma, AMBIGUITY_FLOAT, None))
            continue
        reference = references[key.group]
        value = arc.integer + arc.offset_cycles
        value -= (reference.integer or 0.0) + reference.offset_cycles
        status = AMBIGUITY_FIXED if key in is_new else AMBIGUITY_HELD
        sigma = innovation_sigma / wavelength
        rows.append((reference.key.prn, value, sigma, status, arc.fixed_since))
    names = _names_of(tuple(measured.keys))
    reference_prn, cycles, sigma_cycles, states, fixed_since = (
        zip(*rows, strict=True) if rows else ((),) * 5
    )
    return AmbiguityTable(
        system=names[:, 0],
        prn=names[:, 1],
        band=names[:, 2],
        attribute=names[:, 3],
        reference_prn=np.array(reference_prn, dtype=np.uint8),
        ambiguity_cycles=np.array(cycles, dtype=float),
        ambiguity_sigma_cycles=np.array(sigma_cycles, dtype=float),
        state=np.array(states, dtype=np.uint8),
        fixed_since=fixed_since,
    )


def differential_tec_table(
    state: GaussianState, arcs: ArcBook, measured: SingleDifferences, sky: Sky
) -> DifferentialTecTable:
    """Return the differential slant TEC of the satellites with integers on two carriers.

    The geometry-free phase less its integers is
    ``40.3 STEC (1 / f2^2 - 1 / f1^2) + beta_1 - beta_2``; the biases come from the state.
    """
    pairs = _find_fixed_pairs(arcs, measured)
    if not pairs:
        return DifferentialTecTable()
    values, sigmas = [], []
    # Arithmetic on single numbers of an array takes several times as long.
    phase, phase_variance = measured.phase.tolist(), measured.phase_variance.tolist()
    wavelength, frequency_hz = measured.wavelength.tolist(), measured.frequency_hz.tolist()
    mean, covariance = state.mean, state.covariance
    for first, second in pairs:
        total, variance = 0.0, 0.0
        for row, sign in ((first, 1.0), (second, -1.0)):
            arc = arcs[measured.keys[row]]
            cycles = arc.offset_cycles + (arc.integer or 0.0)
            total += sign * (phase[row] - wavelength[row] * cycles)
            variance += phase_variance[row]
        bias1 = state.index(("phase_bias", measured.keys[first].group))
        bias2 = state.index(("phase_bias", measured.keys[second].group))
        total -= mean.item(bias1) - mean.item(bias2)
        variance += covariance.item(bias1, bias1) + covariance.item(bias2, bias2)
        variance -= 2.0 * covariance.item(bias1, bias2)
        scale = (IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU) * (
            frequency_hz[second] ** -2 - frequency_hz[first] ** -2
        )
        values.append(total / scale)
        sigmas.append(math.sqrt(max(variance, 0.0)) / abs(scale))
    leading = [first for first, _ in pairs]
    names = _names_of(tuple(measured.keys))
    keys = [(measured.keys[first], measured.keys[second]) for first, second in pairs]
    return DifferentialTecTable(
        system=names[leading, 0],
        prn=names[leading, 1],
        band_first=names[leading, 2],
        band_second=names[[second for _, second in pairs], 2],
        stec_tecu=np.array(values),
        stec_sigma_tecu=np.array(sigmas),
        elevation=sky.elevation[leading],
        azimuth=sky.azimuth[leading],
        arc=np.array([max(arcs[a].number, arcs[b].number) for a, b in keys], dtype=np.uint32),
    )


@functools.lru_cache(maxsize=16)
def _names_of(keys: tuple[SignalKey, ...]) -> npt.NDArray[np.uint8]:
    """Return system, number, band and attribute of signals, which stay the same for minutes."""
    names = np.array(keys, dtype=np.uint8).reshape(-1, 4)
    names.flags.writeable = False
    return names


def _find_fixed_pairs(arcs: ArcBook, measured: SingleDifferences) -> list[tuple[int, int]]:
    """Return the rows of the first two carriers of each satellite that have integers."""
    rows_of_satellite: dict[tuple[int, int], list[int]] = {}
    for row, key in enumerate(measured.keys):
        if arcs[key].integer is not None:
            rows_of_satellite.setdefault(key.satellite, []).append(row)
    return [(rows[0], rows[1]) for rows in rows_of_satellite.values() if len(rows) > 1]
