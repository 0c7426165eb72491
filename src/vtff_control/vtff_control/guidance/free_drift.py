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

__all__ = ["DriftRow", "FreeDrift", "closest_of_paths", "fly_drifts"]


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

    def watched(self, states: npt.ArrayLike, distances: FloatArray) -> set[DriftRow]:
        """Return the rows of drifts that come nearer than a distance of each loss, m, (j,)."""
        near = np.linalg.norm(self.paths(states), axis=3) < distances[:, np.newaxis]
        return {DriftRow(*row) for row in np.argwhere(near).tolist()}

    def half_spaces(
        self, states: npt.ArrayLike, rows: list[DriftRow], scale: FloatArray
    ) -> tuple[dict[int, scipy.sparse.csr_matrix], dict[int, FloatArray]]:
        """Return the half-spaces of rows by the paths of states.

        Parameters
        ----------
        states
            As in `paths`.
        rows
            Which instants.
        scale
            Units of the states, shape (6,).

        Returns
        -------
        matrices : dict
            Matrix of each pair: acts on the difference of its states, all steps in one vector
            in units of `scale`, and gives the distances along the normals, m.
        bulges : dict
            What the path between two samples may be nearer than the samples, less what a bend
            adds to the distance, m.
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
        width = 6 * paths.shape[1]
        matrices, bulges = {}, {}
        for pair in range(len(self.pairs)):
            chosen = [row for row in rows if row.pair == pair]
            if not chosen:
                continue
            loss = np.array([row.loss for row in chosen])
            later = np.array([row.later for row in chosen])
            normals = paths[pair, loss, later] / distance[pair, loss, later][:, np.newaxis]
            values = np.einsum("ra,rab->rb", normals, self.positions[loss, later]) * scale
            columns = 6 * loss[:, np.newaxis] + np.arange(6)
            matrices[pair] = scipy.sparse.csr_matrix(
                (
                    values.ravel(),
                    (np.repeat(np.arange(len(chosen)), 6), columns.ravel()),
                ),
                shape=(len(chosen), width),
            )
            bulges[pair] = bulge[pair, loss, later]
            if self.bends is not None:
                bulges[pair] -= np.einsum("ra,ra->r", normals, self.bends[pair, loss, later])
        return matrices, bulges


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
    rotations = np.array([rotation_gcrf_to_rtn(state) for state in np.asarray(references_gcrf)])
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
