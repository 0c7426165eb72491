"""True motion of a formation: every spacecraft propagated in step, thrust held over a step.

The simulator bridge and the in-process closed loop (`vtff_analysis.closed_loop`) both step
the truth with this class, so that a run over the real topics gives the numbers of the fast one.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth import kinematic_matrix
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.gravity import gravity_jerks
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, is_finite
from vtff_sim_bridge.truth.thruster_errors import ThrusterErrors


class _Moment:
    """States and thrusts of a time, whose motions are computed later, and these motions.

    Parameters
    ----------
    time, states
        Time, and position and velocity in GCRF of each spacecraft then.
    thrusts
        Accelerations by thrust in GCRF, m/s2.
    """

    __slots__ = ("motions", "states", "thrusts", "time")

    def __init__(
        self, time: GpsTime, states: Mapping[str, FloatArray], thrusts: Mapping[str, FloatArray]
    ) -> None:
        self.time, self.states, self.thrusts = time, states, thrusts
        self.motions: dict[str, FloatArray] | None = None


class FormationTruth:
    """Propagates the chief and any number of deputies in equal steps.

    Parameters
    ----------
    time
        Epoch of the initial states.
    spacecraft
        Name and GCRF state (m, m/s; shape (6,)) of every spacecraft, the chief first.
    force_model
        Forces on every spacecraft, except thrust.
    force_models
        Forces on spacecraft that differ in them, by name.
    thruster_errors
        What thrusters really give when they report a thrust, by spacecraft; the others give what
        they report.
    integrator
        ``rk4`` or ``euler``, see `vtff_dynamics.orbit.propagator.Propagator`.
    step
        Step in s.

    Raises
    ------
    ValueError
        If there is no spacecraft, two have the same name, or forces or thruster errors are given
        for a spacecraft that is not there.
    """

    def __init__(
        self,
        time: GpsTime,
        spacecraft: Sequence[tuple[str, npt.ArrayLike]],
        force_model: ForceModel,
        integrator: str = "rk4",
        step: float = 1.0,
        *,
        force_models: Mapping[str, ForceModel] | None = None,
        thruster_errors: Mapping[str, ThrusterErrors] | None = None,
    ) -> None:
        if not spacecraft:
            raise ValueError("spacecraft: at least the chief expected, got none")
        names = [name for name, _ in spacecraft]
        if len(set(names)) != len(names):
            raise ValueError(f"spacecraft: names are not unique: {', '.join(names)}")
        force_models, self._thruster_errors = force_models or {}, dict(thruster_errors or {})
        for name in (*force_models, *self._thruster_errors):
            if name not in names:
                raise ValueError(f"unknown spacecraft {name!r}; known: {', '.join(names)}")
        self._chief = names[0]
        self._steps_done = 0
        self._integrator = integrator
        self._rotation: FloatArray | None = None  # from GCRF to RTN of the current step
        # What acts in GCRF in the current step, with the bytes of what is reported for it.
        self._acting: dict[str, tuple[bytes, FloatArray]] = {}
        self._propagators = {
            name: Propagator(
                time,
                np.asarray(state, dtype=float),
                force_models.get(name, force_model),
                integrator=integrator,
                step=step,
            )
            for name, state in spacecraft
        }
        self._time = time
        self._states = {name: each.state_gcrf for name, each in self._propagators.items()}
        self._step_nanoseconds = round(step * NANOSECONDS_PER_SECOND)
        # Moments whose motions somebody may ask for.
        self._moments: list[_Moment] = []

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all spacecraft, the chief first."""
        return tuple(self._propagators)

    @property
    def chief(self) -> str:
        """Name of the chief."""
        return self._chief

    @property
    def deputies(self) -> tuple[str, ...]:
        """Names of all spacecraft but the chief."""
        return self.names[1:]

    @property
    def time(self) -> GpsTime:
        """Time of the current states."""
        return self._time

    def state_gcrf(self, name: str) -> FloatArray:
        """Position and velocity of a spacecraft in GCRF, m and m/s, shape (6,); not to be changed.

        Raises
        ------
        KeyError
            If there is no spacecraft of that name.
        """
        return self._states[name]

    def relative_state_rtn(self, name: str) -> FloatArray:
        """State of a spacecraft relative to the chief in the chief's RTN frame, shape (6,).

        Position in m and velocity in m/s as seen in the frame that turns about N with the rate of
        the osculating orbit, see `vtff_dynamics.frames.rtn.relative_state_rtn`.
        """
        return relative_state_rtn(self.state_gcrf(self._chief), self.state_gcrf(name))

    def advance(
        self,
        accelerations: Mapping[str, npt.ArrayLike] | None = None,
        rotations_to_gcrf: Mapping[str, FloatArray] | None = None,
    ) -> None:
        """Advance every spacecraft by one step.

        Parameters
        ----------
        accelerations
            Thrust acceleration in m/s2 that the thruster of each thrusting spacecraft reports,
            shape (3,), in the RTN axes that the chief has at the start of the step, or in the axes
            of `rotations_to_gcrf`. What acts, with the errors of the thruster, is held inertially
            over the step.
        rotations_to_gcrf
            Rotation, shape (3, 3), from the axes of the thrust to GCRF at the start of the step, of
            spacecraft whose thrusters are not fixed in the chief's RTN axes: those of their bodies.

        Raises
        ------
        ValueError
            If an acceleration is for an unknown spacecraft or is not three finite numbers; nothing
            is advanced then.
        """
        rotations = rotations_to_gcrf or {}
        accelerations_gcrf = {
            name: self._acceleration_gcrf(name, acceleration, rotations.get(name))
            for name, acceleration in (accelerations or {}).items()
        }
        for name, propagator in self._propagators.items():
            self._states[name] = propagator.advance(accelerations_gcrf.get(name))
        self._time = GpsTime(self._time.nanoseconds + self._step_nanoseconds)
        self._steps_done += 1
        self._rotation = None
        self._acting.clear()

    def accelerations_of_thrusters(self, name: str, reported: npt.ArrayLike) -> FloatArray:
        """Return what each of three thrusters gives in the coming step, m/s2, shape (3, 3).

        Row i is that of the thruster of axis i, in the axes of the thrust; see
        `vtff_sim_bridge.truth.thruster_errors.ThrusterErrors`.
        """
        if name in self._thruster_errors:
            return self._thruster_errors[name].accelerations_of_thrusters(
                self._steps_done, reported
            )
        return np.diag(np.asarray(reported, dtype=float))

    def motion_itrf(
        self,
        name: str,
        acceleration: npt.ArrayLike | None = None,
        rotation_to_gcrf: FloatArray | None = None,
    ) -> FloatArray:
        """Earth-fixed motion of a spacecraft for a SimGEN motion command.

        Parameters
        ----------
        name
            Spacecraft.
        acceleration
            Thrust acceleration in m/s2 that the thruster reports for the coming step, in the
            chief's RTN axes, shape (3,). With it an extrapolation of the motion over the step
            follows the truth.
        rotation_to_gcrf
            Rotation, shape (3, 3), from the axes of the thrust to GCRF where they are not those.

        Returns
        -------
        ndarray, shape (4, 3)
            Position (m), velocity (m/s), acceleration (m/s2) and jerk (m/s3) in ITRF, as seen in
            the rotating Earth frame. Acceleration and jerk are zero with ``euler``: that
            integrator moves along straight lines, so an extrapolation with a curvature would
            jump by metres at every step.
        """
        thrusts = {}
        if acceleration is not None:
            thrusts[name] = self._acceleration_gcrf(name, acceleration, rotation_to_gcrf)
        moment = _Moment(self.time, {name: self._states[name]}, thrusts)
        return self._motions(moment)[name]

    def motions_of_now(
        self,
        accelerations: Mapping[str, npt.ArrayLike],
        rotations_to_gcrf: Mapping[str, FloatArray],
    ) -> Callable[[], dict[str, FloatArray]]:
        """Return a function that computes `motion_itrf` of all spacecraft for the present time.

        It may be called when time has gone on: what was asked for before is computed with it, and
        many steps together take a fraction of the time.

        Parameters
        ----------
        accelerations, rotations_to_gcrf
            As for `advance`.
        """
        thrusts = {
            name: self._acceleration_gcrf(name, acceleration, rotations_to_gcrf.get(name))
            for name, acceleration in accelerations.items()
        }
        moment = _Moment(self.time, dict(self._states), thrusts)
        self._moments.append(moment)
        return functools.partial(self._motions, moment)

    def _motions(self, moment: _Moment) -> dict[str, FloatArray]:
        """Return the motions at a moment; compute those of all that wait for it."""
        if moment.motions is None:
            moments, self._moments = self._moments, []
            self._compute_motions(moments if moment in moments else [*moments, moment])
        assert moment.motions is not None
        return moment.motions

    def _compute_motions(self, moments: Sequence[_Moment]) -> None:
        """Compute the motions at some moments, in the order of time."""
        places = [(moment, name) for moment in moments for name in moment.states]
        computed = iter(self._motions_at(places))
        for moment in moments:
            moment.motions = {name: next(computed) for name in moment.states}

    def _motions_at(self, places: Sequence[tuple[_Moment, str]]) -> FloatArray:
        """Return the motions of spacecraft at one moment each, shape (n, 4, 3)."""
        derivatives = np.zeros((len(places), 12))
        derivatives[:, :6] = [moment.states[name] for moment, name in places]
        is_straight = self._integrator == "euler"
        if not is_straight:
            derivatives[:, 6:9] = [
                self._total_acceleration(moment, name) for moment, name in places
            ]
            j2 = np.array([self._propagators[name].force_model.j2_of_jerk for _, name in places])
            derivatives[:, 9:] = gravity_jerks(derivatives[:, :6], j2)
        kinematics = np.array([kinematic_matrix(moment.time) for moment, _ in places])
        motions: FloatArray = (kinematics @ derivatives[:, :, np.newaxis]).reshape(-1, 4, 3)
        if is_straight:
            motions[:, 2:] = 0.0
        return motions

    def _total_acceleration(self, moment: _Moment, name: str) -> FloatArray:
        """Return the acceleration of a spacecraft by forces and thrust, m/s2, shape (3,)."""
        forces = self._propagators[name].force_model
        total = forces.acceleration(moment.time, moment.states[name])
        thrust = moment.thrusts.get(name)
        return total if thrust is None else total + thrust

    def _acceleration_gcrf(
        self, name: str, reported: npt.ArrayLike, rotation_to_gcrf: FloatArray | None = None
    ) -> FloatArray:
        """Return what acts in GCRF when a thruster reports an acceleration in its axes."""
        if name not in self._propagators:
            raise ValueError(
                f"acceleration for unknown spacecraft {name!r}; known: {', '.join(self.names)}"
            )
        acceleration = np.asarray(reported, dtype=float)
        if acceleration.shape != (3,) or not is_finite(acceleration):
            raise ValueError(f"acceleration of {name}: three finite numbers (m/s2) expected")
        content = acceleration.tobytes()
        known = self._acting.get(name)
        if rotation_to_gcrf is None and known is not None and known[0] == content:
            return known[1]
        if name in self._thruster_errors:
            acceleration = self._thruster_errors[name].true_acceleration(
                self._steps_done, acceleration
            )
        if rotation_to_gcrf is not None:
            return np.asarray(rotation_to_gcrf @ acceleration)
        if self._rotation is None:
            self._rotation = rotation_gcrf_to_rtn(self.state_gcrf(self._chief))
        acting: FloatArray = self._rotation.T @ acceleration
        self._acting[name] = content, acting
        return acting
