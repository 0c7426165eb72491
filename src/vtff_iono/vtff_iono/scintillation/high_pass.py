"""High-pass filter without delay.

It is that of `scipy.signal.butter` and `sosfiltfilt` to the last bit (a test compares them). To
import scipy.signal takes 0.7 s of processor, for which a node in real time would stop a minute
after its start.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["HIGH_PASS_ORDER", "compile_kernels", "filter_high_pass"]

HIGH_PASS_ORDER = 3
"""Order of each pass; both make the sixth order that ground receivers have."""

# Samples by which both ends are continued, point-symmetric: three times the coefficients.
_EXTENSION = 12
# Sampling rate of the bilinear transformation, whose frequencies are shares of half the real one.
_RATE = 2.0


def filter_high_pass(values: FloatArray, sample_rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Return what a Butterworth filter of the third order passes, forward and then backward.

    Parameters
    ----------
    values : ndarray, shape (..., n)
    sample_rate_hz : float
    cutoff_hz : float
        Where each of both passes is 3 dB down; below half of the sampling rate.

    Raises
    ------
    ValueError
        If there are too few values.
    """
    count = values.shape[-1]
    if count <= _EXTENSION:
        raise ValueError(f"{count} samples; the filter needs {_EXTENSION + 1}")
    sections = _sections(sample_rate_hz, cutoff_hz)
    first, last = values[..., :1], values[..., -1:]
    extended = np.concatenate(
        (
            2.0 * first - values[..., _EXTENSION:0:-1],
            values,
            2.0 * last - values[..., -2 : -(_EXTENSION + 2) : -1],
        ),
        axis=-1,
    )
    states = _steady_states(sections)
    forward = _filtered(extended, sections, states)
    # A view, as scipy returns it: sums over it add from its last sample on.
    both = _filtered(forward[..., ::-1], sections, states)[..., ::-1]
    return both[..., _EXTENSION:-_EXTENSION]


def _filtered(values: FloatArray, sections: FloatArray, states: FloatArray) -> FloatArray:
    """Return values (..., n) that have passed the sections, from the state of the first value."""
    filtered = np.array(values, order="C")
    _pass_sections(filtered.reshape(-1, filtered.shape[-1]), sections, states)
    return filtered


def compile_kernels() -> None:
    """Compile the filter, which takes seconds without a cache."""
    filter_high_pass(np.zeros(_EXTENSION + 1), 4.0, 1.0)


def _sections(sample_rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Return coefficients b and a of the section of the real pole and of that of the pair."""
    warped = 2.0 * _RATE * np.tan(np.pi * (2.0 * cutoff_hz / sample_rate_hz) / _RATE)
    prototype = -np.exp(1j * np.pi * np.arange(-2, 3, 2) / 6)
    analogue = warped / prototype
    poles = (2.0 * _RATE + analogue) / (2.0 * _RATE - analogue)
    gain = np.real(1.0 / np.prod(-prototype))
    gain *= np.real((2.0 * _RATE) ** 3 / np.prod(2.0 * _RATE - analogue))
    pair = 0.5 * (poles[2] + poles[0].conj())
    # There is a zero at 0 and three are at 1; the pair has the nearest and one at 1.
    zeros = np.array([[1.0, -1.0, 0.0], [1.0, -2.0, 1.0]])
    if abs(pair) <= abs(1.0 - pair):
        zeros = zeros[::-1]
    real, complex_pair = zeros
    return np.array(
        [
            [*(gain * real), 1.0, -poles[1].real, 0.0],
            [*complex_pair, 1.0, -2.0 * pair.real, pair.real**2 + pair.imag**2],
        ]
    )


def _steady_states(sections: FloatArray) -> FloatArray:
    """Return the states (2, 2) of the sections that a constant input of one leads to."""
    states, scale = np.empty((len(sections), 2)), 1.0
    for number, section in enumerate(sections):
        b, a = section[:3], section[3:]
        transition = np.array([[1.0 + a[1], -1.0], [a[2], 1.0]])
        states[number] = scale * np.linalg.solve(transition, b[1:] - a[1:] * b[0])
        scale *= b.sum() / a.sum()
    return states


@compiled
def _pass_sections(rows, sections, states):  # type: ignore[no-untyped-def]
    """Filter rows (m, n) in place: direct form II, transposed."""
    held = np.empty(states.shape)
    for row in rows:
        for section in range(len(sections)):
            held[section, 0] = states[section, 0] * row[0]
            held[section, 1] = states[section, 1] * row[0]
        for place in range(len(row)):
            value = row[place]
            for section in range(len(sections)):
                b0, b1, b2 = sections[section, 0], sections[section, 1], sections[section, 2]
                a1, a2 = sections[section, 4], sections[section, 5]
                passed = b0 * value + held[section, 0]
                held[section, 0] = b1 * value - a1 * passed + held[section, 1]
                held[section, 1] = b2 * value - a2 * passed
                value = passed
            row[place] = value
