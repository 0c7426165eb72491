"""Reconfiguration of a formation with least thrust, a cap on the thrust, and a closest approach.

The motion is linear (`vtff_dynamics.relative.linearised`), the thrust is constant in RTN during
each step. The distance of two spacecraft is not convex; each pass replaces it by half-spaces whose
normals are the directions of the pair in the pass before. A half-space holds at both ends of a
step, and its distance carries what the path between them bulges towards the other spacecraft, so
that the closest approach holds between the steps too. Every solved pass is within the limits;
further passes only save thrust. Passive safety adds half-spaces on the free drift from the start of
every step, which hold, and on those from times within the steps, which may fall short: where two
drifts next to each other in time have to pass a spacecraft on different sides, one step between
them stays in which a loss of thrust is not safe. The plan tells it.

References
----------
Morgan, Chung and Hadaegh (2014), Model Predictive Control of Swarms of Spacecraft Using Sequential
Convex Programming, J. Guidance Control Dynamics 37(6), section IV, for the half-spaces; Breger and
How (2008), Safe Trajectories for Autonomous Rendezvous of Spacecraft, J. Guidance Control Dynamics
31(5), for passive safety; Scala and others (2021), FFLAS mission extension ("paper 002"), section
4.4.1, for the problem.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import time

import cvxpy
import numpy as np
import numpy.typing as npt
import scipy.sparse

from vtff_control.guidance.free_drift import (
    DriftRow,
    FreeDrift,
    closest_during_steps,
    closest_of_paths,
)
from vtff_control.guidance.reconfiguration_plan import (
    InfeasibleReconfigurationError,
    ReconfigurationLimits,
    ReconfigurationPlan,
)
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.relative.linearised import LinearisedMotion
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["ReconfigurationPlanner"]

_SOLVED = ("optimal", "optimal_inaccurate")
_WATCH = 5.0  # m above the limit within which a drift gets half-spaces
_SMALLEST_SHORTFALL = 1e-4  # m that counts as none
_GROWTH, _GAIN = 1.3, 0.5
"""How many times its last distance, and m more, a drift after a loss during a step is asked.

Asked for the whole distance at once, the drifts after losses at both ends of a step often end on
opposite sides of the other spacecraft, from where no pass brings them together.
"""
_BOUND_PASSES = 4
_PRICE = 100.0
"""Steps of full thrust for a metre that a drift falls short: far above what a metre saves."""


class ReconfigurationPlanner:
    """Plans of one formation about one orbit; the convex problem is compiled once.

    Parameters
    ----------
    motion
        Relative motion over the steps of the reconfiguration, and over the free drift after it
        that must be safe: steps beyond `steps` switch passive safety on.
    spacecraft
        Number of spacecraft that move.
    limits
        Limits of every plan.
    steps
        Steps of the reconfiguration; default all of the motion.

    Raises
    ------
    ValueError
        If there are more steps than the motion has.
    """

    def __init__(
        self,
        motion: LinearisedMotion,
        spacecraft: int,
        limits: ReconfigurationLimits,
        steps: int | None = None,
    ) -> None:
        steps = motion.count if steps is None else steps
        if not 0 < steps <= motion.count:
            raise ValueError(f"steps: 1 to {motion.count} expected, got {steps}")
        self.motion = motion.first(steps)
        self.limits = limits
        self.spacecraft = spacecraft
        self.pairs = list(itertools.combinations(range(spacecraft), 2))
        self._drift = FreeDrift(motion, steps, spacecraft) if motion.count > steps else None
        self._axes = ["RTN".index(axis) for axis in limits.axes]
        mean_motion = math.sqrt(GM_EARTH / norm(motion.states_reference_gcrf[0, :3]) ** 3)
        # Lengths for all states and shares of the cap for the thrust: numbers near one.
        self._scale = np.array([1.0] * 3 + [mean_motion] * 3)
        self._compile()

    def _compile(self) -> None:
        count, craft, scale = self.motion.count, self.spacecraft, self._scale
        self._thrust = [cvxpy.Variable((count, len(self._axes))) for _ in range(craft)]
        self._states = [cvxpy.Variable((count + 1, 6)) for _ in range(craft)]
        self._initial = cvxpy.Parameter((craft, 6))
        self._final = cvxpy.Parameter((craft, 6))
        transition = scipy.sparse.block_diag(
            [matrix / scale[:, np.newaxis] * scale for matrix in self.motion.transitions]
        ).tocsr()
        effect = scipy.sparse.block_diag(list(self._effects())).tocsr()
        motion = []
        for index, (states, thrust) in enumerate(zip(self._states, self._thrust, strict=True)):
            carried = transition @ cvxpy.vec(states[:-1], order="C")
            carried += effect @ cvxpy.vec(thrust, order="C")
            motion += [
                cvxpy.vec(states[1:], order="C") == carried,
                states[0] == self._initial[index],
                states[-1] == self._final[index],
            ]
        self._normals = [cvxpy.Parameter((count, 3)) for _ in self.pairs]
        self._distances = [cvxpy.Parameter(count) for _ in self.pairs]
        self._shortfall = cvxpy.Variable(nonneg=True)
        self._share = cvxpy.Variable(nonneg=True)
        apart, nearly_apart = [], []
        for (first, second), normals, distances in zip(
            self.pairs, self._normals, self._distances, strict=True
        ):
            difference = self._states[second][:, :3] - self._states[first][:, :3]
            for ends in (difference[:-1], difference[1:]):
                along = cvxpy.sum(cvxpy.multiply(normals, ends), axis=1)
                apart.append(along >= distances)
                nearly_apart.append(along >= distances - self._shortfall)
        capped = [cvxpy.abs(thrust) <= 1.0 for thrust in self._thrust]
        scaled = [cvxpy.abs(thrust) <= self._share for thrust in self._thrust]
        self._problem = cvxpy.Problem(cvxpy.Minimize(self._cost()), motion + apart + capped)
        self._least_cap = cvxpy.Problem(cvxpy.Minimize(self._share), motion + scaled)
        self._least_shortfall = cvxpy.Problem(
            cvxpy.Minimize(self._shortfall), motion + nearly_apart + capped
        )

    def _effects(self) -> FloatArray:
        """Return the effects of full thrust on the scaled states, shape (n, 6, axes)."""
        effects: FloatArray = (
            self.limits.acceleration_cap
            * self.motion.effects[:, :, self._axes]
            / self._scale[:, np.newaxis]
        )
        return effects

    def _cost(self) -> cvxpy.Expression:
        if self.limits.objective == "energy":
            return sum(cvxpy.sum_squares(thrust) for thrust in self._thrust)
        if self.limits.objective == "axes" or len(self._axes) == 1:
            return sum(cvxpy.sum(cvxpy.abs(thrust)) for thrust in self._thrust)
        return sum(cvxpy.sum(cvxpy.norm(thrust, 2, axis=1)) for thrust in self._thrust)

    def _cost_of(self, accelerations: FloatArray) -> float:
        shares = accelerations / self.limits.acceleration_cap
        if self.limits.objective == "energy":
            return float((shares**2).sum())
        if self.limits.objective == "axes":
            return float(np.abs(shares).sum())
        return float(np.linalg.norm(shares, axis=2).sum())

    def plan(
        self,
        initial_states: npt.ArrayLike,
        final_states: npt.ArrayLike,
        earlier: ReconfigurationPlan | None = None,
        bends: FloatArray | None = None,
    ) -> ReconfigurationPlan:
        """Return a plan.

        Parameters
        ----------
        initial_states, final_states
            Relative states of the spacecraft, m and m/s, shape (m, 6).
        earlier
            A plan of the same or a similar reconfiguration, from which the passes start.
        bends
            With passive safety: `bends` of the earlier plan.

        Raises
        ------
        InfeasibleReconfigurationError
            If there is no plan within the limits.
        """
        begin = time.perf_counter()
        initial = np.asarray(initial_states, dtype=float)
        final = np.asarray(final_states, dtype=float)
        self._check_ends(initial, final)
        self._initial.value = initial / self._scale
        self._final.value = final / self._scale
        if self._drift is not None and earlier is not None and earlier.safe_step is not None:
            accelerations, passes = earlier.accelerations, 0
        else:
            accelerations, passes = self._pass_until_converged(initial, final, earlier)
        safe_step, drifts, during = None, None, None
        if self._drift is not None:
            self._drift.bends = bends
            accelerations, safe_step, more = self._make_passively_safe(
                initial, final, accelerations, earlier
            )
            passes += more
            paths = self._drift.paths(self.motion.fly(initial, accelerations))
            drifts, during = closest_of_paths(paths), closest_during_steps(paths)
        path = self.motion.fly_within(initial, accelerations)
        return ReconfigurationPlan(
            step=self.motion.step,
            accelerations=accelerations,
            states=self.motion.fly(initial, accelerations),
            closest_approach=self._closest(path),
            closest_drifts=drifts,
            closest_drifts_during=during,
            safe_step=safe_step,
            passes=passes,
            solve_time=time.perf_counter() - begin,
        )

    def bends(self, plan: ReconfigurationPlan, paths: FloatArray) -> FloatArray:
        """Return by how much the drifts of a plan bend from linear motion, m, as `FreeDrift.bends`.

        Parameters
        ----------
        plan
            A plan with passive safety.
        paths
            Its drifts in nonlinear motion, of `vtff_control.guidance.free_drift.fly_drifts`.
        """
        assert self._drift is not None
        return paths - self._drift.linear_paths(plan.states)

    def keep_apart(self, closest_approach: float) -> None:
        """Set the closest approach of the plans to come, m; the problem stays compiled."""
        self.limits = dataclasses.replace(self.limits, closest_approach=closest_approach)

    def _pass_until_converged(
        self, initial: FloatArray, final: FloatArray, earlier: ReconfigurationPlan | None
    ) -> tuple[FloatArray, int]:
        """Return thrust without passive safety, and the passes that it took."""
        cost = math.inf
        if earlier is None:
            none = np.zeros((self.spacecraft, self.motion.count, 3))
            accelerations = self._steer(initial, final, none, 0)
        else:
            accelerations = earlier.accelerations
            cost = self._cost_of(accelerations)
        passes = 0
        while passes < self.limits.largest_passes:
            self._linearise(initial, accelerations)
            passes += 1
            if not _solve(self._problem):
                accelerations = self._approach_limits(initial, accelerations)
                continue
            accelerations = self._accelerations()
            before, cost = cost, float(self._problem.value)
            if abs(before - cost) <= self.limits.converged_share * cost:
                break
        if not math.isfinite(cost):
            raise self._too_near(0.0)
        return accelerations, passes

    def _check_ends(self, initial: FloatArray, final: FloatArray) -> None:
        wanted = self.limits.closest_approach
        for states, when in ((initial, "start"), (final, "end")):
            if states.shape != (self.spacecraft, 6) or not np.isfinite(states).all():
                raise ValueError(
                    f"states at the {when}: {self.spacecraft} times 6 finite numbers expected"
                )
            for first, second in self.pairs:
                distance = norm(states[second, :3] - states[first, :3])
                if distance < wanted:
                    raise InfeasibleReconfigurationError(
                        f"closest_approach: {wanted:g} m wanted, but spacecraft {first} and "
                        f"{second} are {distance:.3f} m apart at the {when}",
                        "closest_approach",
                        wanted,
                        distance,
                    )

    def _steer(
        self, initial: FloatArray, final: FloatArray, given: FloatArray, first: int
    ) -> FloatArray:
        """Return given thrust (m, n, 3) with the least change of energy that reaches the end.

        The change begins at step `first`; cap and other spacecraft do not count.
        """
        blocks = []
        to_end = np.eye(6)
        for index in range(self.motion.count - 1, first - 1, -1):
            effect = to_end @ self.motion.effects[index][:, self._axes]
            blocks.append(effect / self._scale[:, np.newaxis])
            to_end = to_end @ self.motion.transitions[index]
        missing = (final - self.motion.fly(initial, given)[:, -1]) / self._scale
        solution = np.linalg.lstsq(np.hstack(blocks[::-1]), missing.T, rcond=None)[0].T
        accelerations: FloatArray = given.copy()
        accelerations[:, first:, self._axes] += solution.reshape(
            self.spacecraft, -1, len(self._axes)
        )
        return accelerations

    def _linearise(self, initial: FloatArray, accelerations: FloatArray) -> None:
        """Set the half-spaces by a path: a normal and a distance for each step and pair."""
        path = self.motion.fly_within(initial, accelerations)
        fraction = np.linspace(0.0, 1.0, path.shape[2])
        for index, (first, second) in enumerate(self.pairs):
            difference = path[second] - path[first]
            middle = difference[:, [0, -1]].mean(axis=1)
            normals = middle / np.maximum(np.linalg.norm(middle, axis=1), 1e-9)[:, np.newaxis]
            along = np.einsum("nsi,ni->ns", difference, normals)
            chord = along[:, :1] + fraction * (along[:, -1:] - along[:, :1])
            self._normals[index].value = normals
            bulge = np.maximum((chord - along).max(axis=1), 0.0)
            self._distances[index].value = self.limits.closest_approach + bulge

    def _accelerations(self) -> FloatArray:
        accelerations = np.zeros((self.spacecraft, self.motion.count, 3))
        for index, thrust in enumerate(self._thrust):
            accelerations[index][:, self._axes] = np.clip(thrust.value, -1.0, 1.0)
        return accelerations * self.limits.acceleration_cap

    def _closest(self, path: FloatArray) -> float:
        return min(
            (
                closest_on_path((path[second] - path[first]).reshape(-1, 3))
                for first, second in self.pairs
            ),
            default=math.inf,
        )

    def _approach_limits(self, initial: FloatArray, accelerations: FloatArray) -> FloatArray:
        """Return thrust whose half-spaces allow a plan, from some whose half-spaces do not.

        Raises
        ------
        InfeasibleReconfigurationError
            If there is none; the error says which limit fails, and by how much.
        """
        cap = self.limits.acceleration_cap
        if not _solve(self._least_cap):
            raise InfeasibleReconfigurationError(
                f"axes: no thrust along {self.limits.axes} alone reaches the final states",
                "axes",
                math.nan,
                math.nan,
            )
        share = float(self._share.value)
        if share > 1.0:
            raise InfeasibleReconfigurationError(
                f"acceleration_cap: {cap:.4g} m/s2 allowed on each axis, {share * cap:.4g} needed "
                f"to arrive in {self.motion.step * self.motion.count:.0f} s",
                "acceleration_cap",
                cap,
                share * cap,
            )
        closest = 0.0
        for _ in range(self.limits.largest_passes):
            self._linearise(initial, accelerations)
            if not _solve(self._least_shortfall):
                break
            accelerations = self._accelerations()
            closest = max(closest, self._closest(self.motion.fly_within(initial, accelerations)))
            if float(self._shortfall.value) < _SMALLEST_SHORTFALL:
                return accelerations
        raise self._too_near(closest)

    def _too_near(self, closest: float) -> InfeasibleReconfigurationError:
        wanted = self.limits.closest_approach
        return InfeasibleReconfigurationError(
            f"closest_approach: {wanted:g} m wanted, {closest:.3f} m reachable within the cap",
            "closest_approach",
            wanted,
            closest,
        )

    def first_safe_step(self, initial_states: npt.ArrayLike) -> int:
        """Return the first step at which a loss of thrust can be safe, whatever comes after.

        Parameters
        ----------
        initial_states
            Relative states, m and m/s, shape (m, 6).

        Raises
        ------
        InfeasibleReconfigurationError
            If the cap does not allow it within the reconfiguration.
        """
        return self._widen_drifts(initial_states)[0]

    def _widen_drifts(self, initial_states: npt.ArrayLike) -> tuple[int, FloatArray]:
        """Return the first safe step, and thrust until there that makes it safe, (m, n, 3)."""
        drift = self._drift
        if drift is None:
            raise ValueError("motion: steps beyond those of the reconfiguration are needed")
        initial = np.asarray(initial_states, dtype=float)
        wanted = self.limits.closest_approach
        accelerations = np.zeros((self.spacecraft, self.motion.count, 3))
        reached = 0.0
        for step in range(self.motion.count + 1):
            if step:
                reached, accelerations = self._widest_drift(drift, initial, accelerations, step)
            else:
                reached = float(drift.closest(initial[:, np.newaxis])[0])
            if reached >= wanted:
                return step, accelerations
        raise InfeasibleReconfigurationError(
            f"passive_safety: {wanted:g} m wanted after a loss of thrust, {reached:.3f} m "
            "reachable",
            "passive_safety",
            wanted,
            reached,
        )

    def _widest_drift(
        self, drift: FreeDrift, initial: FloatArray, accelerations: FloatArray, step: int
    ) -> tuple[float, FloatArray]:
        """Return the largest closest drift (m) from a step that the cap allows, and the thrust."""
        thrust = [cvxpy.Variable((step, len(self._axes))) for _ in range(self.spacecraft)]
        effects = self._effects()
        blocks = []
        to_step = np.eye(6)
        for index in range(step - 1, -1, -1):
            blocks.append(to_step @ effects[index])
            to_step = to_step @ (
                self.motion.transitions[index] / self._scale[:, np.newaxis] * self._scale
            )
        effect = np.hstack(blocks[::-1])
        free = initial / self._scale @ to_step.T
        reached = 0.0
        for _ in range(_BOUND_PASSES):
            states = self.motion.fly(initial, accelerations[:, :step])
            reached = max(reached, float(drift.closest(states)[step]))
            rows = [
                DriftRow(pair, step, later)
                for pair in range(len(self.pairs))
                for later in range(drift.samples + 1)
            ]
            half_spaces = drift.half_spaces(states, rows, self._scale)
            widest = cvxpy.Variable()
            constraints = [cvxpy.abs(values) <= 1.0 for values in thrust]
            for pair, (first, second) in enumerate(self.pairs):
                change = cvxpy.vec(thrust[second], order="C") - cvxpy.vec(thrust[first], order="C")
                last = half_spaces[pair].matrix[:, 6 * step :]
                along = last @ (free[second] - free[first] + effect @ change)
                constraints.append(along - half_spaces[pair].bulges >= widest)
            if not _solve(cvxpy.Problem(cvxpy.Maximize(widest), constraints)):
                break
            accelerations = accelerations.copy()
            for craft, values in enumerate(thrust):
                accelerations[craft, :step][:, self._axes] = (
                    np.clip(values.value, -1.0, 1.0) * self.limits.acceleration_cap
                )
            states = self.motion.fly(initial, accelerations[:, :step])
            reached = max(reached, float(drift.closest(states)[step]))
            if reached >= self.limits.closest_approach:
                break
        return reached, accelerations

    def _make_passively_safe(
        self,
        initial: FloatArray,
        final: FloatArray,
        accelerations: FloatArray,
        earlier: ReconfigurationPlan | None,
    ) -> tuple[FloatArray, int, int]:
        """Return thrust whose loss is safe, the first step from which it is, and the passes.

        The passes start from an earlier safe plan, or else near the plan without passive safety,
        whose first steps are replaced by those that widen the drifts. Half-spaces of drifts may
        first fall short at a high price; those within steps may do so in the end, too.
        """
        drift = self._drift
        assert drift is not None
        wanted = self.limits.closest_approach
        floor = min(wanted, float(drift.closest(initial[:, np.newaxis])[0]))
        safe_step, widening = self._widen_drifts(initial)
        cost = math.inf
        if earlier is not None and earlier.safe_step is not None:
            cost = self._cost_of(earlier.accelerations)
        else:
            accelerations = accelerations.copy()
            accelerations[:, :safe_step] = widening[:, :safe_step]
            accelerations = self._steer(initial, final, accelerations, safe_step)
        rows: set[DriftRow] = set()
        for passes in range(1, self.limits.largest_passes_safe + 1):
            distances = np.where(np.arange(self.motion.count + 1) < safe_step, floor, wanted)
            states = self.motion.fly(initial, accelerations)
            asked = distances.copy()
            asked[:-1] = np.minimum(asked[:-1], _GROWTH * drift.closest_during(states) + _GAIN)
            # A loss at the first step cannot be prevented by any thrust.
            rows |= {row for row in drift.watched(states, asked + _WATCH) if row.loss}
            self._linearise(initial, accelerations)
            problem = self._safe_problem(drift, states, sorted(rows), asked)
            if not _solve(problem):
                break
            accelerations = self._accelerations()
            before, cost = cost, float(problem.value)
            closest = drift.closest(self.motion.fly(initial, accelerations))
            unsafe = np.flatnonzero(closest[1:] < distances[1:] - _SMALLEST_SHORTFALL) + 1
            if abs(before - cost) <= self.limits.converged_share * cost:
                if not len(unsafe):
                    return accelerations, safe_step, passes
                if unsafe[-1] == safe_step:
                    safe_step += 1
        raise InfeasibleReconfigurationError(
            f"passive_safety: {wanted:g} m wanted after a loss of thrust, "
            f"{float(closest[safe_step:].min()):.3f} m reached",
            "passive_safety",
            wanted,
            float(closest[safe_step:].min()),
        )

    def _safe_problem(
        self, drift: FreeDrift, states: FloatArray, rows: list[DriftRow], distances: FloatArray
    ) -> cvxpy.Problem:
        constraints = list(self._problem.constraints)
        shortfalls = cvxpy.Variable(len(distances), nonneg=True)
        for pair, beyond in drift.half_spaces(states, rows, self._scale).items():
            first, second = self.pairs[pair]
            difference = self._states[second] - self._states[first]
            along = beyond.matrix @ cvxpy.vec(difference, order="C")
            wanted = distances[beyond.losses] + beyond.bulges
            constraints.append(along + shortfalls[beyond.losses] >= wanted)
        price = _PRICE * cvxpy.sum(shortfalls)
        return cvxpy.Problem(cvxpy.Minimize(self._problem.objective.expr + price), constraints)


def _solve(problem: cvxpy.Problem) -> bool:
    """Solve a problem; return whether there is a solution."""
    try:
        problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.SolverError:
        return False
    return problem.status in _SOLVED
