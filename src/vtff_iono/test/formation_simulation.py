"""Two spacecraft in a spherical ionosphere: exact rays, known density, carrier-phase noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_iono.geometry.mapping import profile_content

RADIUS = 6378137.0
NOISE_ONE_SECOND = 0.0043
"""TECU; 1 mm on each of four carrier phases, mean of 20 samples."""


def chapman(altitude, peak_density=1.3e12, peak=375e3, scale=60e3, scale_below=None):
    below = scale if scale_below is None else scale_below
    argument = (altitude - peak) / np.where(altitude < peak, below, scale)
    return peak_density * np.exp(0.5 * (1.0 - argument - np.exp(-argument)))


def plumex_like(seed=0, rms=0.05, step=200.0):
    """SYNTHETIC profile after the PLUMEX I flight: ledge, three bubbles, k^-2.5 irregularities."""
    altitude = np.arange(100e3, 2000e3, step)
    density = chapman(altitude) * 0.5 * (1.0 + np.tanh((altitude - 260e3) / 7e3))
    for low, high, depth in ((340e3, 380e3, 0.5), (395e3, 435e3, 0.7), (480e3, 520e3, 0.8)):
        edges = [low - 1e3, low + 1e3, high - 1e3, high + 1e3]
        density *= 1.0 - depth * np.interp(altitude, edges, [0.0, 1.0, 1.0, 0.0])
    inside = (altitude >= 200e3) & (altitude < 600e3)
    count = np.count_nonzero(inside)
    wavenumber = np.fft.rfftfreq(count, step)
    amplitude = np.where(wavenumber >= 1 / 25e3, np.maximum(wavenumber, 1e-9) ** -1.25, 0.0)
    draws = np.random.default_rng(seed).standard_normal((2, len(wavenumber)))
    noise = np.fft.irfft(amplitude * (draws[0] + 1j * draws[1]), count)
    density[inside] *= 1.0 + rms * noise / np.sqrt(np.mean(noise**2))
    return altitude, density


def mean_density(altitude, density, low, high):
    """Return the density averaged between altitudes, from the integral of the linear table."""
    steps = np.diff(altitude)
    total = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * steps)))

    def integral(h):
        index = np.clip(np.searchsorted(altitude, h) - 1, 0, len(altitude) - 2)
        part = h - altitude[index]
        slope = (density[index + 1] - density[index]) / steps[index]
        return total[index] + part * (density[index] + 0.5 * slope * part)

    return (integral(high) - integral(low)) / (high - low)


@dataclass
class Flight:
    """Geometry and contents each second."""

    time: np.ndarray
    altitude_chief: np.ndarray
    altitude_deputy: np.ndarray
    elevation_chief: np.ndarray
    elevation_deputy: np.ndarray
    stec_chief: np.ndarray
    stec_deputy: np.ndarray
    vtec_chief: np.ndarray


def fly(
    profile,
    offset=1000.0,
    in_track=-15e3,
    satellites=24,
    seed=1,
    start=1050.0,
    step=1.0,
    end=2750.0,
):
    """Fly from 600 km down to 236 km, at most 304 m/s of vertical speed, as in the paper."""
    altitude, density = profile
    generator = np.random.default_rng(seed)
    time = np.arange(start, end, step)
    rate = 2.0 * np.pi / 5500.0
    chief = 502e3 + 266e3 * np.cos(rate * time)
    deputy = chief + offset
    direction = generator.standard_normal((satellites, 3))
    gps = 26_560e3 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    angle = rate * time

    def seen(height, along):
        up = np.stack((np.cos(along), np.sin(along), np.zeros_like(along)), axis=-1)
        ray = gps - ((RADIUS + height)[:, None] * up)[:, None, :]
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        return np.arcsin((ray * up[:, None, :]).sum(axis=-1))

    def content(elevation, height):
        result = np.full(elevation.shape, np.nan)
        for index, (row, h) in enumerate(zip(elevation, height, strict=True)):
            up = row > np.radians(9.0)
            result[index, up] = profile_content(row[up], RADIUS + h, altitude, density)
        return result

    elevation_chief = seen(chief, angle)
    elevation_deputy = seen(deputy, angle + in_track / (RADIUS + chief))
    vertical = content(np.full((len(time), 1), 0.5 * np.pi), chief)[:, 0]
    return Flight(
        time=time,
        altitude_chief=chief,
        altitude_deputy=deputy,
        elevation_chief=elevation_chief,
        elevation_deputy=elevation_deputy,
        stec_chief=content(elevation_chief, chief),
        stec_deputy=content(elevation_deputy, deputy),
        vtec_chief=vertical,
    )
