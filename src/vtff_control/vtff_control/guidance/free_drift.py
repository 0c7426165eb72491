"""Free drift after a loss of thrust: how near spacecraft come, whenever the thrust is lost."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse

from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.linearised import LinearisedMotion
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "DriftRow",
    "FreeDrift",
    "HalfSpaces",
    "closest_during_steps",
    "closest_of_paths",
    "fly_drifts",
]


@dataclass(frozen=True, order=True)
class DriftRow:
    """One instant of one drift of one pair.

    Attributes
    ----------
    pair
        Index of the pair.
    loss
        Step at whose start all thrust is lost.
    later
        Steps after that.
    """

    pair: int
    loss: int
    later: int


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """Half-spaces of the drifts of one pair.

    Attributes
    ----------
    matrix
        Acts on the difference of the states of the pair, all steps in one vector in scaled units,
        and gives the distances along the normals, m.
    bulges
        What the path between two samples may be nearer than the samples, less what a bend adds to
        the distance, m, shape (r,).
    losses
        Step of the loss of each, shape (r,).
    """

    matrix: scipy.sparse.csr_matrix
    bulges: FloatArray
    losses: npt.NDArray[np.intp]


class FreeDrift:
    """Drifts of a formation from every step of a manoeuvre.

    Parameters
    ----------
    motion
        Relative motion over the manoeuvre and the drift after its end.
    count
        Steps of the manoeuvre.
    spacecraft
        Number of spacecraft.

    Attributes
    ----------
    bends
        By how much the drifts of a plan nearby bend from linear motion, m, shape (pairs, count + 1,
        samples + 1, 3); None for linear drifts.
    """

    def __init__(self, motion: LinearisedMotion, count: int, spacecraft: int) -> None:
        self.count = count
        self.bends: FloatArray | None = None
        self.samples = motion.count - count
        self.pairs = list(itertools.combinations(range(spacecraft), 2))
        # positions[j, k] carries a state at step j to the position k steps later.
        self.positions = np.array(
            [
                np.linalg.solve(
                    motion.from_start[start].T,
                    motion.from_start[start : start + self.samples + 1, :3].reshape(-1, 6).T,
                ).T.reshape(-1, 3, 6)
                for start in range(count + 1)
            ]
        )

    def paths(self, states: npt.ArrayLike) -> FloatArray:
        """Return the relative positions of all pairs after every loss, with `bends`, m.

        Parameters
        ----------
        states
            Relative states at the ends of the steps, m and m/s, shape (m, j, 6).

        Returns
        -------
        ndarray, shape (pairs, j, samples + 1, 3)
        """
        paths = self.linear_paths(states)
        if self.bends is not None:
            paths += self.bends[:, : paths.shape[1]]
        return paths

    def linear_paths(self, states: npt.ArrayLike) -> FloatArray:
        """Return the same as `paths` in linear motion, without `bends`."""
        state = np.asarray(states, dtype=float)
        differences = np.array([state[second] - state[first] for first, second in self.pairs])
        paths: FloatArray = np.einsum(
            "jkab,pjb->pjka", self.positions[: state.shape[1]], differences
        )
        return paths

    def closest(self, states: npt.ArrayLike) -> FloatArray:
        """Return the smallest distance of all pairs after each loss, m, shape (j,).

        Parameters
        ----------
        states
            As in `paths`.
        """
        return closest_of_paths(self.paths(states))

    def closest_during(self, states: npt.ArrayLike) -> FloatArray:
        """Return the smallest distance after a loss at any time of each step, m, shape (j - 1,).

        Parameters
        ----------
        states
            As in `paths`.
        """
        return closest_during_steps(self.paths(states))

    def watched(self, states: npt.ArrayLike, distances: FloatArray) -> set[DriftRow]:
        """Return the rows of drifts that come nearer than a distance of each loss, m, (j,).

        A row of the start of a step also stands for the losses during that step.
        """
        paths = self.paths(states)
        distance = np.linalg.norm(paths, axis=3)
        during = np.linalg.norm(_nearest_during_steps(paths), axis=3)
        distance[:, :-1, 1:] = np.minimum(distance[:, :-1, 1:], during)
        near = distance < distances[:, np.newaxis]
        return {DriftRow(*row) for row in np.argwhere(near).tolist()}

    def half_spaces(
        self, states: npt.ArrayLike, rows: list[DriftRow], scale: FloatArray
    ) -> dict[int, HalfSpaces]:
        """Return the half-spaces of the rows of each pair by the paths of states.

        The drifts after a loss at the start and at the end of a step share one normal at each
        instant: if both are beyond it, so is the drift after a loss during the step, which lies
        between them but for what the motion bends over a step.

        Parameters
        ----------
        states
            As in `paths`.
        rows
            Which instants.
        scale
            Units of the states, shape (6,).
        """
        paths = self.paths(states)
        distance = np.maximum(np.linalg.norm(paths, axis=3), 1e-9)
        second = np.zeros(paths.shape)
        second[:, :, 1:-1] = paths[:, :, 2:] - 2.0 * paths[:, :, 1:-1] + paths[:, :, :-2]
        turned = np.zeros(distance.shape)
        turn = np.linalg.norm(np.diff(paths / distance[..., np.newaxis], axis=2), axis=3)
        turned[:, :, 1:] = turn
        turned[:, :, :-1] = np.maximum(turned[:, :, :-1], turn)
        # A path is nearer between samples by its curvature, and a chord by the turn of the pair.
        bulge = 0.125 * (np.linalg.norm(second, axis=3) + distance * turned**2)
        nearest = paths.copy()
        nearest[:, :-1, 1:] = _nearest_during_steps(paths)
        last = paths.shape[1] - 1
        found = {}
        for pair in range(len(self.pairs)):
            chosen = np.array([(row.loss, row.later) for row in rows if row.pair == pair])
            if not len(chosen):
                continue
            shared = chosen[(chosen[:, 0] < last) & (chosen[:, 1] > 0)]
            rows_of_pair = np.concatenate((chosen, shared))
            losses = rows_of_pair[:, 0]
            normals = nearest[pair, losses, rows_of_pair[:, 1]]
            normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-9)[:, np.newaxis]
            loss, later = np.concatenate((chosen, shared + (1, -1))).T
            values = np.einsum("ra,rab->rb", normals, self.positions[loss, later]) * scale
            columns = 6 * loss[:, np.newaxis] + np.arange(6)
            matrix = scipy.sparse.csr_matrix(
                (values.ravel(), (np.repeat(np.arange(len(loss)), 6), columns.ravel())),
                shape=(len(loss), 6 * paths.shape[1]),
            )
            bulges = bulge[pair, loss, later]
            if self.bends is not None:
                bulges = bulges - np.einsum("ra,ra->r", normals, self.bends[pair, loss, later])
            found[pair] = HalfSpaces(matrix, bulges, losses)
        return found


def _nearest_during_steps(paths: FloatArray) -> FloatArray:
    """Return the nearest relative positions after losses during each step.

    Parameters
    ----------
    paths
        As of `FreeDrift.paths`, shape (pairs, j, samples + 1, 3).

    Returns
    -------
    ndarray, shape (pairs, j - 1, samples, 3)
        At the samples after the first one of the start of the step. The drift after a loss during
        a step lies on the chord of those after losses at both of its ends.
    """
    start, end = paths[:, :-1, 1:], paths[:, 1:, :-1]
    chord = end - start
    length = np.maximum(np.einsum("...a,...a->...", chord, chord), 1e-18)
    fraction = np.clip(-np.einsum("...a,...a->...", start, chord) / length, 0.0, 1.0)
    nearest: FloatArray = start + fraction[..., np.newaxis] * chord
    return nearest


def closest_during_steps(paths: FloatArray) -> FloatArray:
    """Return the smallest distance after a loss at any time of each step, m, shape (j - 1,).

    Parameters
    ----------
    paths
        As of `FreeDrift.paths`.
    """
    closest: FloatArray = np.linalg.norm(_nearest_during_steps(paths), axis=3).min(axis=(0, 2))
    return closest


def fly_drifts(
    states_gcrf: npt.ArrayLike, references_gcrf: npt.ArrayLike, step: float
) -> FloatArray:
    """Return the relative positions of all pairs after every loss in nonlinear motion with J2, m.

    Parameters
    ----------
    states_gcrf
        States of all spacecraft at each loss, m and m/s, shape (j, m, 6).
    references_gcrf
        States of the reference orbit from the first loss to the end of the last drift, m and m/s,
        shape (j + samples, 6).
    step
        Between losses, and between the samples of a drift, s.

    Returns
    -------
    ndarray, shape (pairs, j, samples + 1, 3)
        In RTN of the reference orbit at the time of the sample, as `FreeDrift.paths`.
    """
    starts = np.asarray(states_gcrf, dtype=float)
    losses, spacecraft = starts.shape[:2]
    rotations = rotation_gcrf_to_rtn(references_gcrf)
    samples = len(rotations) - losses
    flown = free_flight(starts.reshape(-1, 6), step * np.arange(samples + 1))[..., :3]
    positions = flown.reshape(samples + 1, losses, spacecraft, 3)
    times = np.arange(losses)[:, np.newaxis] + np.arange(samples + 1)
    paths: FloatArray = np.array(
        [
            np.einsum(
                "jkab,kjb->jka", rotations[times], positions[:, :, second] - positions[:, :, first]
            )
            for first, second in itertools.combinations(range(spacecraft), 2)
        ]
    )
    return paths


def closest_of_paths(paths: FloatArray) -> FloatArray:
    """Return the smallest distance of all pairs after each loss, m, shape (j,).

    Parameters
    ----------
    paths
        As of `FreeDrift.paths`.
    """
    return np.array(
        [
            min(closest_on_path(paths[pair, loss]) for pair in range(len(paths)))
            for loss in range(paths.shape[1])
        ]
    )
