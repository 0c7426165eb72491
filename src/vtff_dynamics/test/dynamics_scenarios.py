"""Orbits that several test modules of vtff_dynamics share."""

import json
import math
import pathlib

import numpy as np

from vtff_dynamics.frames.earth import right_ascension_from_longitude
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.time.timescales import parse_epoch

EPOCH = parse_epoch("2016-03-21T01:00:00 GPS")


def reference_orbit():
    """Return an orbit of one hour on which four codes agree within 20 um."""
    path = pathlib.Path(__file__).parent / "orbit/reference_1h.json"
    return json.loads(path.read_text())


def remote_sensing_elements():
    """Return the chief and deputy of paper 000, table 1, as facts read it (true anomaly)."""
    node = right_ascension_from_longitude(EPOCH, math.radians(67.489))
    return tuple(
        ClassicalElements(
            semi_major_axis,
            0.044,
            math.radians(10.0),
            node,
            math.pi,
            math.radians(true_anomaly),
        )
        for semi_major_axis, true_anomaly in ((6880540.0, -90.0), (6879040.0, -90.125))
    )


def rk4(derivative, state, start, step, steps):
    """Integrate an autonomous or time-dependent system; an independent reference."""
    state = np.array(state, dtype=float)
    for index in range(steps):
        t = start + index * step
        k1 = derivative(t, state)
        k2 = derivative(t + step / 2, state + step / 2 * k1)
        k3 = derivative(t + step / 2, state + step / 2 * k2)
        k4 = derivative(t + step, state + step * k3)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state
