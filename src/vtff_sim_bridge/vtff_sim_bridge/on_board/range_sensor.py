"""Emulated on-board sensor of range and direction: what a spacecraft sees of its neighbours."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray, cross, norm
from vtff_sim_bridge.noise.gauss_markov import SlowGaussMarkov
from vtff_sim_bridge.noise.random_streams import Effect, generator, receiver_number

__all__ = ["RangeSensor", "RangeSensorEmulation"]


@dataclass(frozen=True)
class RangeSensor:
    """Emulated sensor of range and direction.

    Parameters
    ----------
    range_limit
        m; no neighbour is seen from further away.
    range_sigma
        White noise of a range, m.
    direction_sigma
        White noise of a direction on each axis, rad.
    dropout
        Probability that a detection is missing.
    misalignment_sigma
        Error of the attitude that directions refer to, on each axis, rad: the same for all
        neighbours, slow.
    misalignment_time
        Correlation time of that error, s.
    outage
        Start and end of a failure in which the sensor sees nothing, s after the start.

    Raises
    ------
    ValueError
        If a value is out of its range; the message names it.
    """

    range_limit: float = 10e3
    range_sigma: float = 0.3
    direction_sigma: float = 2e-4
    dropout: float = 0.05
    misalignment_sigma: float = 0.0
    misalignment_time: float = 600.0
    outage: tuple[float, float] = (math.inf, math.inf)

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("range_limit", "range_sigma", "direction_sigma", "misalignment_sigma"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name}: 0 or more expected, got {getattr(self, name):g}")
        if not self.misalignment_time > 0.0:
            raise ValueError(
                f"misalignment_time: more than 0 s expected, got {self.misalignment_time:g}"
            )
        if not 0.0 <= self.dropout <= 1.0:
            raise ValueError(f"dropout: 0 to 1 expected, got {self.dropout:g}")


class RangeSensorEmulation:
    """The sensor of one spacecraft.

    What it sees at a time depends on the time, the seed and the names, not on the order of the
    calls.

    Parameters
    ----------
    sensor
        Its errors.
    spacecraft
        Name of the spacecraft that carries it.
    seed
        Seed of the run.
    """

    def __init__(self, sensor: RangeSensor, spacecraft: str, seed: int) -> None:
        self._sensor = sensor
        self._number = receiver_number(spacecraft)
        self._seed = seed
        self._misalignment = SlowGaussMarkov(
            seed, Effect.SENSOR_MISALIGNMENT, (self._number,), 3, sensor.misalignment_time
        )

    def detect(
        self, nanoseconds: int, own_gcrf: FloatArray, others_gcrf: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return relative positions of the neighbours that are seen, m, shape (k, 3).

        Parameters
        ----------
        nanoseconds
            Time after the start, ns.
        own_gcrf
            True state of the spacecraft, m and m/s, shape (6,).
        others_gcrf
            True state of every other spacecraft by its name.

        Returns
        -------
        ndarray, shape (k, 3)
            In the own RTN frame, the nearest first: the sensor tells no names.
        """
        sensor, seconds = self._sensor, nanoseconds * 1e-9
        if sensor.outage[0] <= seconds < sensor.outage[1]:
            return np.empty((0, 3))
        to_rtn = rotation_gcrf_to_rtn(own_gcrf)
        turn = sensor.misalignment_sigma * self._misalignment.at([seconds])[0]
        stream = generator(self._seed, Effect.RANGE_SENSOR, self._number, nanoseconds)
        seen: list[FloatArray] = []
        for name in sorted(others_gcrf):
            # All is drawn for every neighbour, so that one that is not seen changes no other.
            is_dropped = stream.random() < sensor.dropout
            error = stream.standard_normal(4)
            position = to_rtn @ (others_gcrf[name][:3] - own_gcrf[:3])
            distance = norm(position)
            if is_dropped or not 0.0 < distance <= sensor.range_limit:
                continue
            direction = position / distance
            direction = direction + cross(turn, direction) + sensor.direction_sigma * error[:3]
            measured = distance + sensor.range_sigma * float(error[3])
            seen.append(measured * direction / norm(direction))
        return np.array(sorted(seen, key=norm)).reshape(-1, 3)
