"""Potential of neighbours in the plane of relative eccentricity vectors: a cluster held by orbits.

At rest in the rotating frame a chaser pays for every metre that it stands above or below the lead.
Here the members have the same semi-major axis and mean latitude instead, and differ in eccentricity
vectors: each goes round the others once in an orbit, on an ellipse whose half axes are the
difference of the vectors (radial) and twice that (in-track). No two are nearer than the difference,
the differences keep their size under J2, and so the potential of `potential_field` is climbed in
their plane. With inclination vectors that differ at right angles to them, by the square root of
three as much, the ellipses become circles, and all distances stay as they are: the triangle of
paper 001, turning.

A cluster at rest first moves, still at rest, to places from which one velocity change leads to such
orbits (`JoiningField`). Elements are mean ones: under J2 the osculating elements of members a
kilometre apart differ by metres that come and go, and a guidance that follows them pays for it.

References
----------
D'Amico and Montenbruck (2006), Proximity operations of formation-flying spacecraft using an
eccentricity/inclination vector separation, JGCD 29(3), 554-563, doi:10.2514/1.15114, for relative
orbital elements. That the potential acts in the plane of eccentricity vectors is of this project.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_control.cluster.potential_field import PotentialField, climb, shortened, stiffness
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.orbit.mean_elements import (
    elements_from_state,
    mean_elements,
    short_period_elements,
)
from vtff_dynamics.relative.relative_elements import control_matrix, relative_elements_of
from vtff_dynamics.relative.transition import j2_transition_matrix
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["SHAPES", "ElementsField", "JoiningField"]

SHAPES = ("ellipse", "circle", "helix")
"""In the orbital plane of each, round with constant distances, and with parallel eccentricity and
inclination vectors. The last alone keeps members apart when one of them fails and drifts along the
track: in the other two the paths of a member that drifts and of one that does not thrust cross."""

_RADIAL, _IN_TRACK, _NORMAL = range(3)
_AXIS, _LATITUDE, _ECCENTRICITY_Y, _INCLINATION_X = 0, 1, 3, 4
_CIRCLE = math.sqrt(3.0)
# Length of the inclination vector for that of the eccentricity vector.
_INCLINATION_RATIO: dict[str, float] = {"circle": _CIRCLE, "helix": 1.0}
_KILOMETRE = 1e3  # m
_HALF_AXES = np.array([1.0, 0.5])
_STEEP = 600.0  # m
_NARROW, _WIDE = 500.0, 650.0  # m
_NEAR = 1e3  # m: about the ring of the potential


@dataclass(frozen=True)
class JoiningField(PotentialField):
    """Guidance at rest towards places from which the orbits of a shape are joined.

    `ElementsField.join` leaves the eccentricity vector (-x, -y/2) of a member that was at rest at
    height x and y ahead. Two members that are 864 m apart along the track would thus be 432 m apart
    in their first ellipses. So the potential is climbed in the plane of the vectors while the
    cluster is still at rest, and out of the orbital plane a member goes where its inclination
    vector will belong.

    Parameters
    ----------
    shape
        One of `SHAPES`.
    normal_share
        Part of what is missing out of the orbital plane that one step takes off, once no vector is
        near: members that are apart across the track alone go apart in the plane first.
    """

    shape: str = "helix"
    normal_share: float = 0.2

    def _step(self, positions: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
        ratio = 2.0 if self.shape == "circle" else 1.0
        vectors = ratio * _HALF_AXES * positions[:, :2]
        nearest = float(np.linalg.norm(vectors, axis=1).min())
        vectors = _no_nearer(vectors)
        # In a plane many neighbours are near, and all of them move at the same time.
        gain = min(self.gain, 0.5 / stiffness(vectors))
        along = _KILOMETRE * gain / ratio * climb(vectors, chosen)
        step = np.zeros(3)
        step[:2] = along / _HALF_AXES
        own = step - positions[chosen].mean(axis=0)
        wanted = {"helix": 0.5 * own[_IN_TRACK], "circle": _CIRCLE * own[_RADIAL]}
        missing = wanted.get(self.shape, 0.0) - own[_NORMAL]
        clear = min(max((nearest - _NARROW) / (_WIDE - _NARROW), 0.0), 1.0)
        step[_NORMAL] = clear * self.normal_share * missing
        return shortened(step, self.longest_step)


@dataclass(frozen=True)
class ElementsField:
    """Guidance of one chaser of a cluster that is held by its orbits.

    Parameters
    ----------
    shape
        One of `SHAPES`.
    gain
        Step in the plane of eccentricity vectors for a unit gradient, km^2.
    longest_step
        m.
    drift_time
        In which a small difference of latitudes is drifted off, s.
    quiet_share
        Part of a small error of an element that one thrust takes off: small, so that the noise of
        the tracks is averaged.
    reach
        Error of an element that is taken off at once, m.
    slack
        How far from where the potentials of all balance a member stays where it is, m. Many members
        in a plane would move on for many orbits, together and by little.
    least_distance
        Two that will come nearer than this go apart at once, m.
    acceleration_density
        Root of the spectral density of a neighbour's thrust in a cluster of orbits, m/s^1.5.
    free_thrust
        Sigma with which the mean thrust of a neighbour at rest is known, m/s2.
    spreading_time
        For which the cluster stays at rest before the orbits are joined, s; see `JoiningField`.

    Raises
    ------
    ValueError
        If the shape is not known.
    """

    shape: str = "helix"
    gain: float = 0.07
    longest_step: float = 250.0
    drift_time: float = 2400.0
    quiet_share: float = 0.04
    reach: float = 150.0
    slack: float = 15.0
    least_distance: float = 650.0
    acceleration_density: float = 1e-4
    free_thrust: float = 2e-4
    spreading_time: float = 2400.0

    def __post_init__(self) -> None:
        """Check the shape."""
        if self.shape not in SHAPES:
            raise ValueError(f"shape: one of {', '.join(SHAPES)} expected, got {self.shape!r}")

    @property
    def stays_without_thrust(self) -> bool:
        """Whether the cluster stays together without thrust; a chaser that is blind waits."""
        return True

    @property
    def held_thrust(self) -> float:
        """Mean thrust of a neighbour, m/s2: orbits need none."""
        return 0.0

    @property
    def at_rest(self) -> JoiningField:
        """Guidance before the orbits are joined."""
        return JoiningField(shape=self.shape)

    def thrust_density(self, change: FloatArray, interval: float) -> float:
        """Return the root of the spectral density of a neighbour's thrust, m/s^1.5.

        All follow the same field: the others thrust about as much as the chaser itself.

        Parameters
        ----------
        change
            The chaser's own last velocity change, m/s, shape (3,).
        interval
            Between two such changes, s.
        """
        return math.hypot(self.acceleration_density, norm(change) / math.sqrt(interval))

    def impulse(
        self,
        neighbours: npt.ArrayLike,
        own_gcrf: FloatArray,
        interval: float,
        followed: npt.ArrayLike | None = None,
        thrusts: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the velocity change of the chaser, m/s in its RTN frame, shape (3,).

        Parameters and the mean that is followed are those of `PotentialField.impulse`. In-track
        velocity takes off the difference of semi-major axes, which makes members drift apart, or
        leaves what takes off that of latitudes. Radial velocity moves the eccentricity vector,
        whose two components come by turns as the frame turns.
        """
        states = np.asarray(neighbours, dtype=float).reshape(-1, 6)
        chosen = np.ones(len(states), bool) if followed is None else np.asarray(followed, bool)
        if not chosen.any():
            return np.zeros(3)
        elements, mean_motion = _mean_elements_from_here(states, own_gcrf)
        effect = control_matrix(mean_motion, 0.0)
        own = -elements[chosen].mean(axis=0)
        vectors, heeded = self._vectors(elements, effect, chosen)
        nearest = float(np.linalg.norm(vectors[heeded], axis=1).min())
        vectors = _no_nearer(vectors)
        step = self._eccentricity_step(vectors, heeded, chosen)
        turn, share = float(step[1]), self.quiet_share
        if nearest < self.least_distance:
            # Too near: away at once, by the component that can be changed now. All do so.
            length = math.hypot(*step.tolist()) * min(
                1.0, 0.5 / (self.gain * stiffness(vectors[heeded]))
            )
            turn, share = math.copysign(length, turn), 1.0
        # A higher orbit is a slower one: dl/dt = -1.5 n a.
        drift = own[_LATITUDE] / self.drift_time
        missing = drift / (1.5 * mean_motion) - own[_AXIS]
        change = np.zeros(3)
        change[_IN_TRACK] = self._share(missing) * missing / effect[_AXIS, _IN_TRACK]
        change[_RADIAL] = share * turn / effect[_ECCENTRICITY_Y, _RADIAL]
        missing = self.quiet_share * self._missing_inclination(own, own[2:4])
        change[_NORMAL] = missing / effect[_INCLINATION_X, _NORMAL]
        return change

    def _missing_inclination(self, own: FloatArray, vector: FloatArray) -> float:
        """Return by how much the inclination vector is to change where it can now, m.

        Parameters
        ----------
        own
            Relative elements, m, shape (6,).
        vector
            Eccentricity vector, m, shape (2,).
        """
        ratio = _INCLINATION_RATIO.get(self.shape)
        if ratio is None:
            return 0.0
        # N = c R in a circle, and in phase with T in a helix.
        wanted = -ratio * vector[1] if self.shape == "circle" else ratio * vector[0]
        return float(wanted - own[_INCLINATION_X])

    def join(
        self,
        neighbours: npt.ArrayLike,
        own_gcrf: FloatArray,
        followed: npt.ArrayLike | None = None,
        thrusts: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the velocity change that turns a cluster at rest into one of orbits, m/s, (3,).

        From where it is, each goes round the one that it follows and that falls freely, with its
        semi-major axis and mean latitude: the members that hold a place at rest will go round it as
        well. Members that were so far apart at rest are nowhere nearer than half of that.
        Parameters are those of `impulse`.
        """
        states = np.asarray(neighbours, dtype=float).reshape(-1, 6)
        chosen = np.ones(len(states), bool) if followed is None else np.asarray(followed, bool)
        change = np.zeros(3)
        if chosen.any():
            acting = np.zeros((len(states), 3)) if thrusts is None else np.asarray(thrusts, float)
            elements, mean_motion = _mean_elements_from_here(states[chosen], own_gcrf)
            effect = control_matrix(mean_motion, 0.0)
            squares = np.sum(acting.reshape(-1, 3)[chosen] ** 2, axis=1)
            # A hundredth of one at rest would be metres of semi-major axis; squares leave less.
            weights = 1.0 / (squares + self.free_thrust**2) ** 2
            others = weights @ elements / weights.sum()
            change[_IN_TRACK] = others[_AXIS] / effect[_AXIS, _IN_TRACK]
            change[_RADIAL] = others[_LATITUDE] / effect[_LATITUDE, _RADIAL]
            joined = -others + effect[:, :2] @ change[:2]
            missing = self._missing_inclination(joined, joined[2:4])
            change[_NORMAL] = missing / effect[_INCLINATION_X, _NORMAL]
        return change

    def _share(self, error: float) -> float:
        return min(max(abs(error) / self.reach, self.quiet_share), 1.0)

    def _vectors(
        self, elements: FloatArray, effect: FloatArray, chosen: npt.NDArray[np.bool_]
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Return how far neighbours are at least, as eccentricity vectors, and which are heeded.

        The vectors, m, shape (k, 2), are those without differences of axes, whose corrections move
        them, times what inclinations add where an ellipse is narrow.
        """
        corrections = elements[:, _AXIS] / effect[_AXIS, _IN_TRACK]
        vectors = elements[:, 2:4] - np.outer(corrections, effect[2:4, _IN_TRACK])
        across = elements[:, 5] * vectors[:, 0] - elements[:, 4] * vectors[:, 1]
        squares = np.maximum(np.sum(vectors**2, axis=1), 1.0)
        ratios = np.hypot(1.0, np.minimum(np.abs(across) / squares, _CIRCLE))
        # One that is not followed and not met is not avoided either.
        heeded = chosen | _meets_within_half_an_orbit(elements, vectors)
        return ratios[:, np.newaxis] * vectors, heeded

    def _eccentricity_step(
        self,
        vectors: FloatArray,
        heeded: npt.NDArray[np.bool_],
        chosen: npt.NDArray[np.bool_],
    ) -> FloatArray:
        """Return where the own eccentricity vector is to go, m, shape (2,)."""
        ratio = 2.0 if self.shape == "circle" else 1.0
        gradient = climb(vectors[heeded], chosen[heeded])
        off = _KILOMETRE * math.hypot(*gradient.tolist()) / stiffness(vectors[heeded])
        share = max(0.0, 1.0 - self.slack / max(off, 1e-6))
        return shortened(share * _KILOMETRE * self.gain / ratio * gradient, self.longest_step)


def _no_nearer(vectors: FloatArray) -> FloatArray:
    """Return vectors of at least 600 m with their directions.

    Further in the wall of the potential is so steep that a step which halves its slope is short.
    """
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors * np.maximum(1.0, _STEEP / np.maximum(lengths, 1.0)))


def _mean_elements_from_here(states: FloatArray, own_gcrf: FloatArray) -> tuple[FloatArray, float]:
    """Return mean relative elements of neighbours, m, shape (k, 6), and the mean motion, rad/s.

    Latitude counts from the chaser: its axes turn, and with them the vectors of all alike. The
    semi-major axis is less what J2 asks for: without a difference of it the latitudes drift by the
    inclinations and eccentricities alone.

    Parameters
    ----------
    states
        Relative states, m and m/s, shape (k, 6).
    own_gcrf
        State of the chaser, m and m/s, shape (6,).
    """
    osculating = elements_from_state(own_gcrf)
    own = mean_elements(osculating)
    elements = np.empty((len(states), 6))
    for row, state in enumerate(states):
        other = elements_from_state(deputy_state_gcrf(own_gcrf, state))
        # J2 moves a neighbour as the chaser but for millimetres: one step of the iteration.
        mean = other - short_period_elements(own + (other - osculating))
        elements[row] = relative_elements_of(own, mean)
    mean_motion = math.sqrt(GM_EARTH / float(own[0]) ** 3)
    drift = j2_transition_matrix(own, 2.0 * math.pi / mean_motion)[_LATITUDE]
    elements[:, _AXIS] += elements[:, 2:] @ drift[2:] / drift[_AXIS]
    sine, cosine = math.sin(own[1]), math.cos(own[1])
    turn = np.array([[cosine, -sine], [sine, cosine]])
    elements[:, 2:4] = elements[:, 2:4] @ turn
    elements[:, 4:] = elements[:, 4:] @ turn
    return elements, mean_motion


def _meets_within_half_an_orbit(elements: FloatArray, vectors: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which neighbours may come near along the track, shape (k,).

    One that drifts is ahead or behind by its difference of latitudes, less twice the length of the
    eccentricity vector.

    Parameters
    ----------
    elements
        Relative elements, m, shape (k, 6).
    vectors
        Eccentricity vectors, m, shape (k, 2).
    """
    now = elements[:, _LATITUDE]
    later = now - 1.5 * math.pi * elements[:, _AXIS]
    least = np.where(now * later <= 0.0, 0.0, np.minimum(np.abs(now), np.abs(later)))
    reached: npt.NDArray[np.bool_] = least - 2.0 * np.linalg.norm(vectors, axis=1) <= _NEAR
    return reached
