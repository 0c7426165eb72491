"""A magnetometer on a spacecraft that turns: samples and periods for tests of the filters."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.attitude.quaternion import conjugate, multiply, rotation_vector
from vtff_dynamics.attitude.rigid_body import AttitudeState
from vtff_dynamics.attitude.spacecraft import AttitudePropagator, SpacecraftBody
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.time.timescales import parse_epoch
from vtff_nav.attitude.attitude_filter import FilterPeriod

EPOCH = parse_epoch("2001-02-08T00:00:00 UTC")
ORBIT = ClassicalElements(7.082e6, 1e-3, math.radians(98.1), 1.0, 0.5, 0.0).to_state()
DIPOLE = np.array([0.034, 0.036, -0.12])
TRACK = OrbitTrack(EPOCH, ORBIT)


class MeasuredFlight:
    """Free flight with a wheel at constant speed; noise of the magnetometer by a seed."""

    def __init__(self, seed, wheel_rpm=0.0, sigma=60e-9, rate=0.004, **body):
        self.generator = np.random.default_rng(seed)
        self.sigma = sigma
        made = SpacecraftBody(**{"dipole": DIPOLE, **body})
        quaternion = self.generator.standard_normal(4)
        self.wheel = made.wheel_momentum(wheel_rpm)
        start = AttitudeState(
            quaternion / np.linalg.norm(quaternion),
            rate * self.generator.standard_normal(3),
            self.wheel,
        )
        self.truth = AttitudePropagator(made, start)
        self.number = 0

    @property
    def state(self):
        return self.truth.state

    def sample(self):
        field = self.state.rotation_gcrf_from_body.T @ TRACK.field_gcrf(self.number)
        return field + self.sigma * self.generator.standard_normal(3)

    def fly(self, pulses=(0.0, 0.0, 0.0), windows=()):
        """Fly a period, with torques of thrusters; return it and the sample at its end."""
        number = self.number
        self.truth.advance(TRACK.interval(number), pulses, windows=windows)
        self.number += 1
        state = TRACK.state_gcrf(number)
        period = FilterPeriod(
            5.0,
            TRACK.field_gcrf(number),
            TRACK.field_gcrf(number + 1),
            state[:3] + 2.5 * state[3:],
            self.wheel,
            self.wheel,
            np.array(pulses, dtype=float),
        )
        return period, self.sample()

    def errors(self, estimate):
        """Return the errors of rotation (rad), rate and dipole, shape (9,)."""
        turned = multiply(conjugate(estimate.quaternion_gcrf), self.state.quaternion_gcrf)
        return np.concatenate(
            (
                rotation_vector(turned),
                self.state.rate_body - estimate.rate_body,
                self.truth.dipole - estimate.dipole,
            )
        )
