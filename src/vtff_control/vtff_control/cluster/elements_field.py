"""Potential of neighbours in the plane of relative eccentricity vectors: a cluster held by orbits.

At rest in the rotating frame a chaser pays for every metre that it stands above or below the lead.
Here the members have the same semi-major axis and mean latitude instead, and differ in eccentricity
vectors: each goes round the others once in an orbit, on an ellipse whose half axes are the
difference of the vectors (radial) and twice that (in-track). No two are nearer than the difference,
the differences keep their size under J2, and so the potential of `potential_field` is climbed in
their plane. With inclination vectors that differ at right angles to them, by the square root of
three as much, the ellipses become circles, and all distances stay as they are: the triangle of
paper 001, turning.

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

from vtff_control.cluster.potential_field import potential_gradient
from vtff_dynamics.relative.relative_elements import control_matrix, linear_map_rtn
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["SHAPES", "ElementsField"]

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
_NEAR = 1e3  # m: about the ring of the potential


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
    acceleration_density
        Root of the spectral density of a neighbour's thrust in a cluster at rest, m/s^1.5.

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
    acceleration_density: float = 1e-4

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
        mean_motion: float,
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
        # Latitude counts from the chaser: its axes turn, and with them the vectors of all alike.
        elements = np.linalg.solve(linear_map_rtn(mean_motion, 0.0), states.T).T
        effect = control_matrix(mean_motion, 0.0)
        own = -elements[chosen].mean(axis=0)
        step = self._eccentricity_step(elements, effect, chosen)
        turn, share = float(step[1]), self.quiet_share
        length = math.hypot(*step.tolist())
        if length > self.reach:
            # Too near: away at once, by the component that can be changed now.
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
        self, neighbours: npt.ArrayLike, mean_motion: float, followed: npt.ArrayLike | None = None
    ) -> FloatArray:
        """Return the velocity change that turns a cluster at rest into one of orbits, m/s, (3,).

        From where it is, each goes round the mean of the others that it follows, with their
        semi-major axis and mean latitude. Members that were so far apart at rest are nowhere nearer
        than half of that. Parameters are those of `impulse`.
        """
        states = np.asarray(neighbours, dtype=float).reshape(-1, 6)
        chosen = np.ones(len(states), bool) if followed is None else np.asarray(followed, bool)
        change = np.zeros(3)
        if chosen.any():
            elements = np.linalg.solve(linear_map_rtn(mean_motion, 0.0), states[chosen].T).T
            others, effect = elements.mean(axis=0), control_matrix(mean_motion, 0.0)
            change[_IN_TRACK] = others[_AXIS] / effect[_AXIS, _IN_TRACK]
            change[_RADIAL] = others[_LATITUDE] / effect[_LATITUDE, _RADIAL]
            joined = -others + effect[:, :2] @ change[:2]
            missing = self._missing_inclination(joined, joined[2:4])
            change[_NORMAL] = missing / effect[_INCLINATION_X, _NORMAL]
        return change

    def _share(self, error: float) -> float:
        return min(max(abs(error) / self.reach, self.quiet_share), 1.0)

    def _eccentricity_step(
        self, elements: FloatArray, effect: FloatArray, chosen: npt.NDArray[np.bool_]
    ) -> FloatArray:
        """Return where the own eccentricity vector is to go, m, shape (2,).

        The vectors are those without differences of axes, whose corrections move them.
        """
        corrections = elements[:, _AXIS] / effect[_AXIS, _IN_TRACK]
        vectors = elements[:, 2:4] - np.outer(corrections, effect[2:4, _IN_TRACK])
        # How far a neighbour is at least: what its inclination adds where the ellipse is narrow.
        across = elements[:, 5] * vectors[:, 0] - elements[:, 4] * vectors[:, 1]
        squares = np.maximum(np.sum(vectors**2, axis=1), 1.0)
        ratios = np.hypot(1.0, np.minimum(np.abs(across) / squares, _CIRCLE))
        distances = ratios[:, np.newaxis] * vectors
        gradient = potential_gradient(distances[chosen], np.zeros(2))
        meets = _meets_within_half_an_orbit(elements, vectors)
        for other in distances[~chosen & meets]:
            # A neighbour that is not followed only repels, and not from afar.
            slope = potential_gradient(other[np.newaxis], np.zeros(2))
            if slope @ other < 0.0:
                gradient = gradient + slope
        step = _KILOMETRE * self.gain / float(ratios[chosen].mean()) * gradient
        length = math.hypot(*step.tolist())
        if length > self.longest_step:
            step *= self.longest_step / length
        return np.asarray(step)


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
