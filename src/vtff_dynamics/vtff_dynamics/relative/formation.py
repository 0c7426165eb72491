"""A formation: a chief and its deputies at an epoch, with checked shapes and units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.checks import check_angle, check_orbit_state, check_vector
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.elements import ClassicalElements, osculating_mean_motion
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["Formation"]

_STEP = 10.0  # s of integration


@dataclass(frozen=True, eq=False)
class Formation:
    """A chief and its deputies at an epoch.

    Parameters
    ----------
    time : GpsTime
    state_chief_gcrf : array_like, shape (6,)
        Position (m) and velocity (m/s) of the chief in GCRF.
    relative_states_rtn : mapping of str to array_like, shape (6,)
        Position (m) and rotating-frame velocity (m/s) of each deputy in the chief's RTN frame.

    Raises
    ------
    ValueError
        If a shape or a unit cannot be right; the text names the parameter, expected and got.

    Examples
    --------
    A deputy 100 m ahead on the same circular orbit is there an hour later too, but for J2:

    >>> from vtff_dynamics.time.timescales import parse_epoch
    >>> start = parse_epoch("2016-03-21T01:00:00 GPS")
    >>> ahead = {"deputy": [0.0, 100.0, 0.0, 0.0, 0.0, 0.0]}
    >>> formation = Formation.on_circular_orbit(start, 6.871e6, 0.785, ahead)
    >>> float(formation.after(3600.0).relative_states_rtn["deputy"][1].round())
    100.0
    """

    time: GpsTime
    state_chief_gcrf: FloatArray
    relative_states_rtn: Mapping[str, FloatArray]

    def __post_init__(self) -> None:
        """Check shapes and units."""
        if not isinstance(self.time, GpsTime):
            raise ValueError(f"time: expected a GpsTime; got {type(self.time).__name__}")
        chief = check_orbit_state("state_chief_gcrf", self.state_chief_gcrf)
        radius = norm(chief[:3])
        deputies = {}
        for deputy, value in self.relative_states_rtn.items():
            name = f"relative_states_rtn[{deputy!r}]"
            state = check_vector(name, value, 6, "m and m/s")
            if norm(state[:3]) > radius:
                raise ValueError(
                    f"{name}: expected a distance below the chief's radius of {radius:.4g} m; "
                    f"got {norm(state[:3]):.4g}"
                )
            check_orbit_state(f"{name}, in GCRF", deputy_state_gcrf(chief, state))
            deputies[deputy] = state
        object.__setattr__(self, "state_chief_gcrf", chief)
        object.__setattr__(self, "relative_states_rtn", deputies)

    @classmethod
    def on_circular_orbit(
        cls,
        time: GpsTime,
        radius: float,
        inclination: float,
        relative_states_rtn: Mapping[str, npt.ArrayLike],
    ) -> Formation:
        """Return a formation whose chief is at the ascending node of a circular orbit.

        Parameters
        ----------
        time : GpsTime
        radius : float
            m, from the centre of the Earth.
        inclination : float
            rad, 0 to pi.
        relative_states_rtn
            As for `Formation`.
        """
        check_angle("inclination", inclination, 0.0, math.pi)
        if not (math.isfinite(radius) and 6.3e6 < radius < 1e9):
            hint = " (is it in km?)" if 6.3e3 < radius < 1e6 else ""
            raise ValueError(f"radius: expected 6.3e6 to 1e9 m; got {radius:g}{hint}")
        elements = ClassicalElements(radius, 0.0, inclination, 0.0, 0.0, 0.0)
        states = {name: np.asarray(state) for name, state in relative_states_rtn.items()}
        return cls(time, elements.to_state(), states)

    @property
    def mean_motion(self) -> float:
        """Osculating mean motion of the chief, rad/s."""
        return osculating_mean_motion(self.state_chief_gcrf)

    def state_gcrf(self, deputy: str) -> FloatArray:
        """Return position (m) and velocity (m/s) of a deputy in GCRF, shape (6,)."""
        return deputy_state_gcrf(self.state_chief_gcrf, self.relative_states_rtn[deputy])

    def after(self, duration: float, force_model: ForceModel | None = None) -> Formation:
        """Return the formation after a time without thrust.

        Parameters
        ----------
        duration : float
            s.
        force_model : ForceModel, optional
            Forces on every spacecraft; default as `ForceModel`.
        """
        if not (math.isfinite(duration) and duration > 0.0):
            raise ValueError(f"duration: expected positive seconds; got {duration!r}")
        end = self.time + duration

        def carried(state: FloatArray) -> FloatArray:
            whole_steps, rest = divmod(duration, _STEP)
            time = self.time
            for count, step in ((int(whole_steps), _STEP), (1, round(rest, 9))):
                if count and step:
                    propagator = Propagator(time, state, force_model, step=step)
                    for _ in range(count):
                        state = propagator.advance()
                    time = propagator.time
            return state

        chief = carried(self.state_chief_gcrf)
        return Formation(
            end,
            chief,
            {
                name: relative_state_rtn(chief, carried(self.state_gcrf(name)))
                for name in self.relative_states_rtn
            },
        )
