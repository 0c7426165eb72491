"""Relative orbital elements as lengths, and the relative states in RTN that belong to them.

A relative orbit is an array of six lengths in m, the chief's semi-major axis times the
quasi-nonsingular relative elements of `vtff_dynamics.orbit.elements`: (delta a, delta lambda,
delta e_x, delta e_y, delta i_x, delta i_y). They may be osculating or mean; the functions say
which. On a nearly circular orbit, with u the mean argument of latitude,

    R = da - dex cos u - dey sin u
    T = dlambda + 2 dex sin u - 2 dey cos u
    N = dix sin u - diy cos u

References
----------
D'Amico (2010), Autonomous Formation Flying in Low Earth Orbit, PhD thesis, sections 2.1 to 2.3.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.elements import (
    ClassicalElements,
    QuasiNonsingularElements,
    RelativeOrbitalElements,
    deputy_elements,
    relative_orbital_elements,
)
from vtff_dynamics.orbit.mean_elements import (
    elements_from_state,
    mean_elements,
    osculating_elements,
    state_from_elements,
)
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "control_matrix",
    "elements_of_deputy",
    "linear_map_rtn",
    "mean_relative_elements",
    "relative_elements_of",
    "relative_elements_rtn",
    "relative_state_of_elements",
    "relative_state_of_mean_elements",
]


def relative_elements_of(
    elements_chief: npt.ArrayLike, elements_deputy: npt.ArrayLike
) -> FloatArray:
    """Return the relative elements of two sets of elements, m, shape (6,).

    Parameters
    ----------
    elements_chief, elements_deputy
        Quasi-nonsingular elements, both osculating or both mean, m and rad, shape (6,).
    """
    chief, deputy = _classical(elements_chief), _classical(elements_deputy)
    return relative_orbital_elements(chief, deputy).to_lengths(chief.semi_major_axis)


def elements_of_deputy(elements_chief: npt.ArrayLike, relative: npt.ArrayLike) -> FloatArray:
    """Return the deputy's elements; the inverse of `relative_elements_of`, shape (6,).

    Parameters
    ----------
    elements_chief
        Quasi-nonsingular elements, m and rad, shape (6,); the result is osculating or mean as they.
    relative
        Relative elements, m, shape (6,).

    Raises
    ------
    ValueError
        If the chief's orbit is equatorial.
    """
    chief = _classical(elements_chief)
    scaled = (np.asarray(relative, dtype=float) / chief.semi_major_axis).tolist()
    deputy = deputy_elements(chief, RelativeOrbitalElements(*scaled))
    return np.array(list(vars(QuasiNonsingularElements.from_classical(deputy)).values()))


def relative_elements_rtn(
    state_chief_gcrf: npt.ArrayLike, relative_state: npt.ArrayLike
) -> FloatArray:
    """Return the osculating relative elements of a relative state, m, shape (6,); exact.

    Parameters
    ----------
    state_chief_gcrf
        Position and velocity of the chief, m and m/s, shape (6,).
    relative_state
        Position and rotating-frame velocity of the deputy in RTN, m and m/s, shape (6,); the frame
        turns about N alone.
    """
    deputy = deputy_state_gcrf(state_chief_gcrf, relative_state)
    return relative_elements_of(elements_from_state(state_chief_gcrf), elements_from_state(deputy))


def relative_state_of_elements(
    state_chief_gcrf: npt.ArrayLike, relative: npt.ArrayLike
) -> FloatArray:
    """Return the relative state in RTN of osculating relative elements, m and m/s, shape (6,).

    The inverse of `relative_elements_rtn`; parameters as there.
    """
    deputy = elements_of_deputy(elements_from_state(state_chief_gcrf), relative)
    return relative_state_rtn(state_chief_gcrf, state_from_elements(deputy))


def mean_relative_elements(
    state_chief_gcrf: npt.ArrayLike, relative_state: npt.ArrayLike
) -> FloatArray:
    """Return the mean relative elements (J2 removed) of a relative state, m, shape (6,).

    Parameters
    ----------
    state_chief_gcrf, relative_state
        As in `relative_elements_rtn`.
    """
    deputy = deputy_state_gcrf(state_chief_gcrf, relative_state)
    return relative_elements_of(
        mean_elements(elements_from_state(state_chief_gcrf)),
        mean_elements(elements_from_state(deputy)),
    )


def relative_state_of_mean_elements(
    elements_chief_mean: npt.ArrayLike, relative: npt.ArrayLike
) -> FloatArray:
    """Return the relative state in RTN of mean relative elements, m and m/s, shape (6,).

    Parameters
    ----------
    elements_chief_mean
        Mean elements of the chief, m and rad, shape (6,).
    relative
        Mean relative elements, m, shape (6,).
    """
    deputy = osculating_elements(elements_of_deputy(elements_chief_mean, relative))
    chief = state_from_elements(osculating_elements(elements_chief_mean))
    return relative_state_rtn(chief, state_from_elements(deputy))


def linear_map_rtn(mean_motion: float, mean_latitude: npt.ArrayLike) -> FloatArray:
    """Return the matrix from relative elements (m) to relative states, nearly circular orbit.

    Its error is of the first order in the eccentricity, and of the second in the distance over the
    radius.

    Parameters
    ----------
    mean_motion
        rad/s.
    mean_latitude
        Mean argument of latitude, rad, any shape.

    Returns
    -------
    ndarray, shape (..., 6, 6)
        Rows: R, T, N in m and their rates in m/s.

    References
    ----------
    D'Amico (2010), eq. (2.17).
    """
    latitude = np.asarray(mean_latitude, dtype=float)
    sine, cosine = np.sin(latitude), np.cos(latitude)
    matrix = np.zeros((*latitude.shape, 6, 6))
    matrix[..., 0, 0] = matrix[..., 1, 1] = 1.0
    matrix[..., 0, 2], matrix[..., 0, 3] = -cosine, -sine
    matrix[..., 1, 2], matrix[..., 1, 3] = 2.0 * sine, -2.0 * cosine
    matrix[..., 2, 4], matrix[..., 2, 5] = sine, -cosine
    matrix[..., 4, 0] = -1.5 * mean_motion
    matrix[..., 3, 2], matrix[..., 3, 3] = mean_motion * sine, -mean_motion * cosine
    matrix[..., 4, 2] = 2.0 * mean_motion * cosine
    matrix[..., 4, 3] = 2.0 * mean_motion * sine
    matrix[..., 5, 4], matrix[..., 5, 5] = mean_motion * cosine, mean_motion * sine
    return matrix


def control_matrix(mean_motion: float, mean_latitude: float) -> FloatArray:
    """Return the change of relative elements (m) by a velocity change (R, T, N; m/s), (6, 3).

    References
    ----------
    D'Amico (2010), eq. (2.38); for a nearly circular orbit.
    """
    sine, cosine = math.sin(mean_latitude), math.cos(mean_latitude)
    return (
        np.array(
            [
                [0.0, 2.0, 0.0],
                [-2.0, 0.0, 0.0],
                [sine, 2.0 * cosine, 0.0],
                [-cosine, 2.0 * sine, 0.0],
                [0.0, 0.0, cosine],
                [0.0, 0.0, sine],
            ]
        )
        / mean_motion
    )


def _classical(elements: npt.ArrayLike) -> ClassicalElements:
    values = np.asarray(elements, dtype=float).tolist()
    return QuasiNonsingularElements(*values).to_classical()
