"""Emulated fix of a spacecraft's own receiver, where a run has no receivers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.fix import STATUS_SINGLE, Fix
from vtff_sim_bridge.noise.gauss_markov import SlowGaussMarkov
from vtff_sim_bridge.noise.random_streams import Effect, generator, receiver_number

__all__ = ["FixErrors", "OwnFixEmulation"]

_SATELLITES = 10


@dataclass(frozen=True)
class FixErrors:
    """Errors of the fix of a receiver without corrections.

    Parameters
    ----------
    position_sigma
        On each axis, m: slow, from orbits, clocks and ionosphere.
    correlation_time
        Correlation time of the error of the position, s.
    velocity_sigma
        On each axis, m/s: white, from the Doppler shift.

    Raises
    ------
    ValueError
        If a value is out of its range; the message names it.
    """

    position_sigma: float = 2.0
    correlation_time: float = 1800.0
    velocity_sigma: float = 0.03

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("position_sigma", "velocity_sigma"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name}: 0 or more expected, got {getattr(self, name):g}")
        if not self.correlation_time > 0.0:
            raise ValueError(
                f"correlation_time: more than 0 s expected, got {self.correlation_time:g}"
            )


class OwnFixEmulation:
    """The fix of one spacecraft; it depends on time, seed and name, not on the order of calls.

    Parameters
    ----------
    errors
        Errors of the fix.
    spacecraft
        Name of the spacecraft.
    seed
        Seed of the run.
    """

    def __init__(self, errors: FixErrors, spacecraft: str, seed: int) -> None:
        self._errors = errors
        self._address = (receiver_number(spacecraft),)
        self._seed = seed
        self._slow = SlowGaussMarkov(
            seed, Effect.FIX_POSITION, self._address, 3, errors.correlation_time
        )

    def measure(self, nanoseconds: int, own_gcrf: FloatArray) -> FloatArray:
        """Return the state that the receiver tells, m and m/s in GCRF, shape (6,).

        Parameters
        ----------
        nanoseconds
            Time after the start, ns.
        own_gcrf
            True state, m and m/s, shape (6,).
        """
        white = generator(self._seed, Effect.FIX_VELOCITY, *self._address, nanoseconds)
        errors = (
            self._errors.position_sigma * self._slow.at([nanoseconds * 1e-9])[0],
            self._errors.velocity_sigma * white.standard_normal(3),
        )
        measured: FloatArray = np.asarray(own_gcrf, dtype=float) + np.concatenate(errors)
        return measured

    def fix(self, time: GpsTime, nanoseconds: int, own_gcrf: FloatArray) -> Fix:
        """Return the same as a fix at a time; parameters as in `measure`."""
        state = state_gcrf_to_itrf(time, self.measure(nanoseconds, own_gcrf)).tolist()
        return Fix(
            time=time,
            status=STATUS_SINGLE,
            receiver_solution_type=0,
            position=tuple(state[:3]),
            velocity=tuple(state[3:]),
            position_sigma=(self._errors.position_sigma,) * 3,
            velocity_sigma=(self._errors.velocity_sigma,) * 3,
            velocity_latency=0.0,
            satellites_tracked=_SATELLITES,
            satellites_used=_SATELLITES,
            clock_offset=float("nan"),
            clock_offset_sigma=float("nan"),
        )
