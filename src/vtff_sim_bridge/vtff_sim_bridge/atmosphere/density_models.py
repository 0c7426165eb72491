"""Builders of electron-density profiles: constant, Chapman, PyIRI, plasma bubble, PLUMEX-like.

All return a frozen `ElectronDensityProfile`; nothing here is called while a simulation runs.
"""

from __future__ import annotations

import datetime
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.atmosphere.electron_density import (
    ElectronDensityProfile,
    ProfileError,
)

__all__ = [
    "PLUMEX_BUBBLES",
    "ChapmanLayer",
    "Depletion",
    "bubble_profile",
    "chapman_profile",
    "constant_profile",
    "depleted_profile",
    "irregular_profile",
    "plumex_like_profile",
    "pyiri_profile",
]


def constant_profile(
    density_per_m3: float, altitude_bottom: float, altitude_top: float
) -> ElectronDensityProfile:
    """Return a slab of constant density (electrons per cubic metre) between two altitudes (m)."""
    return ElectronDensityProfile([altitude_bottom, altitude_top], [density_per_m3] * 2)


@dataclass(frozen=True)
class ChapmanLayer:
    """A Chapman alpha layer.

    Attributes
    ----------
    peak_density_per_m3 : float
        Largest density, electrons per cubic metre.
    peak_altitude : float
        Altitude of the largest density, m.
    scale_height_below, scale_height_above : float
        Scale heights of the bottomside and the topside, m.
    """

    peak_density_per_m3: float
    peak_altitude: float
    scale_height_below: float
    scale_height_above: float

    def __post_init__(self) -> None:
        """Refuse layers that have no meaning."""
        if not self.peak_density_per_m3 >= 0.0:
            raise ProfileError("peak_density_per_m3: must not be negative")
        if not (self.scale_height_below > 0.0 and self.scale_height_above > 0.0):
            raise ProfileError("scale_height_below, scale_height_above: must be positive")

    def density(self, altitude: npt.ArrayLike) -> FloatArray:
        """Return N_m exp((1 - z - exp(-z)) / 2), z = (h - h_m) / H, at altitudes (m).

        References
        ----------
        Rishbeth and Garriott (1969), Introduction to Ionospheric Physics, section 3.3.
        """
        height = np.asarray(altitude, dtype=float) - self.peak_altitude
        scale = np.where(height < 0.0, self.scale_height_below, self.scale_height_above)
        # Beyond -20 the density is exp(-2e8): the limit only keeps exp(-z) finite.
        z = np.maximum(height / scale, -20.0)
        density: FloatArray = self.peak_density_per_m3 * np.exp(0.5 * (1.0 - z - np.exp(-z)))
        return density


def chapman_profile(
    layers: Sequence[ChapmanLayer], altitude: npt.ArrayLike | None = None
) -> ElectronDensityProfile:
    """Return the sum of Chapman layers as a table.

    Parameters
    ----------
    layers : sequence of ChapmanLayer
        One or more layers.
    altitude : array_like, shape (n,), optional
        Altitudes of the table, m. The default, 80 to 2000 km in steps of 250 m, follows layers of
        30 km and more within 1e-5 of their peak density.
    """
    table = np.arange(80e3, 2000.1e3, 250.0) if altitude is None else np.asarray(altitude, float)
    density = np.sum([layer.density(table) for layer in layers], axis=0)
    return ElectronDensityProfile(table, density)


def pyiri_profile(
    time: GpsTime,
    latitude: float,
    longitude: float,
    f10_7_sfu: float,
    altitude: npt.ArrayLike | None = None,
) -> ElectronDensityProfile:
    """Return the profile of the International Reference Ionosphere, by PyIRI.

    PyIRI is an optional package that takes 2 s and 600 MB: build a profile once and freeze it with
    `write_profile`. It is a smooth climatology without plasmasphere, bubbles or tilt.

    Parameters
    ----------
    time : GpsTime
        Day and time of day of the model.
    latitude, longitude : float
        Place, rad, east positive.
    f10_7_sfu : float
        Solar radio flux at 10.7 cm, solar flux units.
    altitude : array_like, shape (n,), optional
        Altitudes of the table, m; default 80 to 2000 km each 5 km and on to 20200 km each 50 km.

    Raises
    ------
    ProfileError
        If PyIRI is not installed.

    References
    ----------
    Forsythe et al. (2024), PyIRI: Whole-globe approach to the International Reference Ionosphere
    modeling implemented in Python, Space Weather 22.
    """
    try:
        sh_library = importlib.import_module("PyIRI.sh_library")
    except ImportError as error:
        raise ProfileError(
            "profile model 'pyiri' needs the optional package PyIRI (pip install PyIRI); "
            "a profile table from a file needs nothing"
        ) from error
    if altitude is None:
        altitude = np.concatenate((np.arange(80e3, 2000e3, 5e3), np.arange(2000e3, 20201e3, 50e3)))
    table = np.asarray(altitude, dtype=float)
    utc = datetime.datetime.fromtimestamp(
        time.to_unix_nanoseconds() / NANOSECONDS_PER_SECOND, tz=datetime.timezone.utc
    )
    hours = utc.hour + (utc.minute + (utc.second + 1e-6 * utc.microsecond) / 60.0) / 60.0
    # The density comes last, shape (times, altitudes, places); altitudes in km, angles in deg.
    density = sh_library.IRI_density_1day(
        utc.year,
        utc.month,
        utc.day,
        np.array([hours]),
        np.array([math.degrees(longitude)]),
        np.array([math.degrees(latitude)]),
        table / 1e3,
        f10_7_sfu,
    )[-1]
    return ElectronDensityProfile(table, np.asarray(density)[0, :, 0])


@dataclass(frozen=True)
class Depletion:
    """A layer in which density is missing.

    Attributes
    ----------
    altitude_bottom, altitude_top : float
        Altitudes of the middle of its two edges, m.
    depth : float
        Part of the density that is missing, 0 to 1.
    edge_width : float
        Width of each edge, in which the missing part rises linearly, m.
    """

    altitude_bottom: float
    altitude_top: float
    depth: float
    edge_width: float = 100.0

    def __post_init__(self) -> None:
        """Refuse depletions that have no meaning."""
        if not 0.0 <= self.depth <= 1.0:
            raise ProfileError(f"depth: must be within 0 and 1, got {self.depth:g}")
        _check_edges(self.altitude_bottom, self.altitude_top, self.edge_width)

    def corners(self) -> FloatArray:
        """Return the altitudes of the four corners of the trapezoid, m."""
        return _corners(self.altitude_bottom, self.altitude_top, self.edge_width)


def _check_edges(altitude_bottom: float, altitude_top: float, edge_width: float) -> None:
    if not 0.0 < edge_width <= altitude_top - altitude_bottom:
        raise ProfileError(
            f"edge_width: must be positive and at most the thickness of the layer, got {edge_width}"
            f" m for {altitude_bottom:g} to {altitude_top:g} m"
        )


def _corners(altitude_bottom: float, altitude_top: float, edge_width: float) -> FloatArray:
    half = 0.5 * edge_width
    return np.array(
        [altitude_bottom - half, altitude_bottom + half, altitude_top - half, altitude_top + half]
    )


def depleted_profile(
    profile: ElectronDensityProfile, depletions: Sequence[Depletion]
) -> ElectronDensityProfile:
    """Return a profile multiplied by ``1 - depth`` in each depletion.

    The corners of the depletions are added to the table, so that edges are as narrow as asked for.
    """
    corners = [depletion.corners() for depletion in depletions]
    altitude = np.unique(np.concatenate([profile.altitude, *corners]))
    density = profile.density(altitude)
    for depletion, corner in zip(depletions, corners, strict=True):
        density = density * (
            1.0 - depletion.depth * np.interp(altitude, corner, [0.0, 1.0, 1.0, 0.0])
        )
    return ElectronDensityProfile(altitude, density)


def bubble_profile(
    background: ElectronDensityProfile,
    altitude_bottom: float = 290e3,
    altitude_top: float = 350e3,
    vtec_bottom_tecu: float = 30.17,
    vtec_top_tecu: float = 30.10,
    edge_width: float = 100.0,
) -> ElectronDensityProfile:
    """Return a background emptied to a plateau of vertical TEC, as in figure 5 of the paper.

    The background is multiplied by one factor and replaced by a constant density between the two
    altitudes; both numbers follow from the two values of the vertical TEC, which are met exactly.

    Parameters
    ----------
    background : ElectronDensityProfile
        Profile outside the bubble, up to a factor.
    altitude_bottom, altitude_top : float
        Altitudes of the middle of the two edges, m.
    vtec_bottom_tecu, vtec_top_tecu : float
        Vertical TEC above these two altitudes, TECU.
    edge_width : float
        Width of the edges, over which the density changes linearly, m.

    Raises
    ------
    ProfileError
        If the two values cannot be met with densities that are not negative.

    References
    ----------
    Peng et al., VTFF testbed, section 4.1 and figure 5 (values of the vertical TEC).
    """
    _check_edges(altitude_bottom, altitude_top, edge_width)
    corners = _corners(altitude_bottom, altitude_top, edge_width)
    outside = background.altitude[
        (background.altitude < corners[0]) | (background.altitude > corners[3])
    ]
    altitude = np.unique(np.concatenate((outside, corners)))
    inside = (altitude > corners[0]) & (altitude < corners[3])
    # The profile is a sum of two shapes, so that the two values of VTEC give two linear equations.
    shapes = [
        ElectronDensityProfile(altitude, np.where(inside, 0.0, background.density(altitude))),
        ElectronDensityProfile(altitude, np.where(inside, 1.0, 0.0)),
    ]
    heights = np.array([altitude_bottom, altitude_top])
    matrix = np.stack([shape.vtec_above_tecu(heights) for shape in shapes], axis=1)
    if abs(np.linalg.det(matrix)) == 0.0:
        raise ProfileError("bubble: the background has no electrons above the bubble")
    factors = np.linalg.solve(matrix, [vtec_bottom_tecu, vtec_top_tecu])
    if not (factors >= 0.0).all():
        raise ProfileError(
            f"bubble: VTEC of {vtec_bottom_tecu:g} and {vtec_top_tecu:g} TECU would need a density "
            f"of {factors[1]:.3g} m-3 inside and a background factor of {factors[0]:.3g}"
        )
    density = factors[0] * shapes[0].density_per_m3 + factors[1] * shapes[1].density_per_m3
    return ElectronDensityProfile(altitude, density)


def irregular_profile(
    profile: ElectronDensityProfile,
    altitude_low: float,
    altitude_high: float,
    rms_relative: float,
    seed: int,
    spectral_index: float = 2.5,
    wavelength_outer: float = 25e3,
    spacing: float = 50.0,
) -> ElectronDensityProfile:
    """Return a profile with random relative fluctuations of a power-law spectrum.

    Parameters
    ----------
    profile : ElectronDensityProfile
        The smooth profile.
    altitude_low, altitude_high : float
        Altitudes between which the density fluctuates, m.
    rms_relative : float
        Root mean square of the fluctuation relative to the density, exact for the draw.
    seed : int
        Seed of the draw.
    spectral_index : float
        Index p of the spatial power spectral density k^-p.
    wavelength_outer : float
        Longest wavelength, m; the shortest is twice `spacing`.
    spacing : float
        Distance of the table altitudes in the irregular part, m.

    Raises
    ------
    ProfileError
        If the layer is thinner than the longest wavelength or a density would become negative.
    """
    count = int(round((altitude_high - altitude_low) / spacing))
    if count * spacing < wavelength_outer or not wavelength_outer > 2.0 * spacing:
        raise ProfileError(
            "wavelength_outer: must lie between twice the spacing and the thickness of the layer"
        )
    wavenumber = np.fft.rfftfreq(count, spacing)
    amplitude = np.zeros(len(wavenumber))
    kept = wavenumber >= 1.0 / wavelength_outer
    amplitude[kept] = wavenumber[kept] ** (-0.5 * spectral_index)
    draws = np.random.default_rng(seed).standard_normal((2, len(wavenumber)))
    fluctuation = np.fft.irfft(amplitude * (draws[0] + 1j * draws[1]), count)
    fluctuation *= rms_relative / math.sqrt(np.mean(fluctuation**2))
    if fluctuation.min() < -1.0:
        raise ProfileError(f"rms_relative: {rms_relative:g} makes the density negative")
    grid = altitude_low + spacing * np.arange(count)
    altitude = np.unique(np.concatenate((profile.altitude, grid)))
    relative = np.interp(altitude, grid, fluctuation, left=0.0, right=0.0)
    return ElectronDensityProfile(altitude, profile.density(altitude) * (1.0 + relative))


PLUMEX_BUBBLES = (
    Depletion(340e3, 380e3, 0.5, 2e3),
    Depletion(395e3, 435e3, 0.7, 2e3),
    Depletion(480e3, 520e3, 0.8, 2e3),
)
"""Bubbles 3, 2 and 1 of the PLUMEX I profile; their depths are assumed, none is published."""


def plumex_like_profile(seed: int, rms_relative: float = 0.05) -> ElectronDensityProfile:
    """Return a synthetic profile that resembles the PLUMEX I rocket flight of 1979-07-17.

    SYNTHETIC: a Chapman layer of 1.3e12 m-3 at 375 km, a ledge at 260 km (scale 7 km), three
    bubbles and irregularities with a k^-2.5 spectrum between 200 and 600 km. Peak density and
    altitude, the altitudes of ledge and bubbles and the spectral index are those published; scale
    heights, depths of the bubbles and the root mean square of the irregularities are assumed.

    Parameters
    ----------
    seed : int
        Seed of the irregularities.
    rms_relative : float
        Root mean square of the irregularities relative to the density; 0 leaves them out.

    References
    ----------
    Geophys. Res. Lett. 7, 537 (1980) and NRL memorandum report AD-A089133 (the flight);
    Peng et al., VTFF testbed, section 4.3 (altitudes of the bubbles).
    """
    altitude = np.concatenate((np.arange(80e3, 700e3, 200.0), np.arange(700e3, 2000.1e3, 1e3)))
    layer = ChapmanLayer(1.3e12, 375e3, 60e3, 60e3)
    ledge = 0.5 * (1.0 + np.tanh((altitude - 260e3) / 7e3))
    smooth = ElectronDensityProfile(altitude, layer.density(altitude) * ledge)
    profile = depleted_profile(smooth, PLUMEX_BUBBLES)
    if rms_relative == 0.0:
        return profile
    return irregular_profile(profile, 200e3, 600e3, rms_relative, seed)
