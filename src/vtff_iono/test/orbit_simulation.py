"""Rays of an eccentric orbit, or of a station, through known profiles, with wrong levels."""

import functools
import math

import numpy as np
from formation_simulation import RADIUS, chapman, plumex_like

from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_iono.bias.bias_samples import BiasSamples
from vtff_iono.geometry.mapping import profile_content

PER_NS = 2.8533508
BIAS = 8.0
ALTITUDE = np.arange(100e3, 2000e3, 1e3)
PLASMASPHERE = np.concatenate((ALTITUDE, np.arange(2000e3, 20e6, 50e3)))
PROFILES = {
    "chapman": (ALTITUDE, chapman(ALTITUDE)),
    "plumex": plumex_like(step=1e3),
    # 3 TECU above 1000 km, which look like a bias.
    "plasmasphere": (
        PLASMASPHERE,
        chapman(PLASMASPHERE) + 3e10 * (PLASMASPHERE / 1000e3) ** -2.0 * (PLASMASPHERE > 300e3),
    ),
}


@functools.lru_cache(maxsize=4)
def seen(name, hours, orbit=True, satellites=32, interval=None, swing=266e3):
    """Time, content, elevation, direction, position and satellite of all rays above 10 deg."""
    generator = np.random.default_rng(1)
    direction = generator.standard_normal((satellites, 3))
    gps = 26_560e3 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    rate = 2.0 * np.pi / (5500.0 if orbit else 43_000.0)
    rows = []
    for time in np.arange(0.0, hours * 3600.0, interval or (20.0 if orbit else 900.0)):
        height = 502e3 + swing * math.cos(rate * time) if orbit else 0.0
        receiver = itrf_from_geodetic([0.0, rate * time, height])
        ray = gps - receiver
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        elevation = np.arcsin(ray @ ellipsoid_normal(receiver))
        up = np.flatnonzero(elevation > math.radians(10.0))
        content = profile_content(elevation[up], RADIUS + height, *PROFILES[name])
        rows += [
            (time, one, elevation[i], *ray[i], *receiver, i)
            for i, one in zip(up, content, strict=True)
        ]
    return np.array(rows)


def samples(rows, seed, level_sigma, bias=BIAS):
    """Contents with a receiver bias and levels wrong by `level_sigma`, new each 25 minutes."""
    arc = (rows[:, 9] * 100 + rows[:, 0] // 1500).astype(np.int64)
    number = np.unique(arc, return_inverse=True)[1]
    levels = np.random.default_rng(seed).normal(0.0, level_sigma, number.max() + 1)
    return BiasSamples(
        time=rows[:, 0],
        group=np.zeros(len(rows), dtype=np.int64),
        stec_tecu=rows[:, 1] + bias + levels[number],
        stec_sigma_tecu=np.full(len(rows), level_sigma),
        elevation=rows[:, 2],
        direction_itrf=rows[:, 3:6],
        position_receiver_itrf=rows[:, 6:9],
        arc=arc,
    )
