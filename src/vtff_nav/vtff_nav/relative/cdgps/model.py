"""Linear measurement model of the relative filter for code, phase and laser range."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray, norm
from vtff_gnss.constants import DELAY_PER_TECU
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.orbit_filter import CHIEF_MOTION
from vtff_nav.relative.cdgps.state import GaussianState, Innovation
from vtff_nav.relative.common.antenna_correction import Attitudes
from vtff_nav.relative.common.columns import make_table
from vtff_nav.relative.common.measurements import Geometry, SingleDifferences
from vtff_nav.relative.common.orbit_single_point import troposphere_delay, troposphere_mapping
from vtff_nav.relative.common.solution import LaserMeasurement
from vtff_nav.relative.kernels.differences import model_differences
from vtff_nav.relative.kernels.sky import sky_columns

__all__ = [
    "PLASMA_KINDS",
    "Sky",
    "code_biases",
    "measurement_innovation",
    "make_sky",
    "phase_waves",
]

PLASMA_KINDS = ("plasma", "plasma_shell")
"""Kinds of the members of the plasma, in the order of the columns of `Sky.plasma_delay`."""

_NO_COLUMNS = np.zeros(0, dtype=np.int64)
_NO_DERIVATIVES = np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class Sky:
    """Geometry of n single differences as the relative filter needs it; columns have shape (n,).

    Parameters
    ----------
    predicted : ndarray
        Range, satellite clock and troposphere of the deputy less those of the chief, for the
        predicted states and without receiver clocks, m.
    direction, direction_chief : ndarray, shape (n, 3)
        Unit vectors from the deputy and from the chief to the satellites, navigation axes.
    clock_rate : ndarray
        Derivative of the single difference by the receiver clock of the deputy (m by m). It is not
        1 because the time of reception, and so the range, depends on the clock.
    plasma_delay : ndarray, shape (n, layers + 3 shells)
        Delay of the code, m, by each layer for a density of `DENSITY_UNIT`, and by each shell for
        1 TECU and for gradients of 1 TECU/deg to north and to east. Phases are advanced by it.
    shell_ratio : float
        Radius of the chief over that of the middle of the shells.
    elevation, azimuth : ndarray
        Direction of the satellites at the chief, rad.
    antenna_offset : ndarray, shape (n, k)
        Derivatives by the errors of lever arms, see `AntennaPair.offset_columns`; k may be 0.
    antenna_turn : ndarray, shape (n, k)
        Derivatives by the errors of estimated attitudes, see `AntennaPair.attitude_columns`.
    ray_turn : ndarray
        Derivative by the error of the satellite's position across its ray, towards the deputy.
    troposphere : ndarray
        Derivative by the difference of the zenith delays over its a priori sigma, m.
    """

    predicted: FloatArray
    direction: FloatArray
    direction_chief: FloatArray
    clock_rate: FloatArray
    plasma_delay: FloatArray
    shell_ratio: float
    elevation: FloatArray
    azimuth: FloatArray
    antenna_offset: FloatArray
    antenna_turn: FloatArray
    ray_turn: FloatArray
    troposphere: FloatArray

    def select(self, rows: npt.NDArray[np.intp]) -> Sky:
        """Return the sky of some of the single differences."""
        columns = {
            name: getattr(self, name)[rows]
            for name in self.__dataclass_fields__
            if name != "shell_ratio"
        }
        return Sky(shell_ratio=self.shell_ratio, **columns)

    @functools.cached_property
    def wave(self) -> FloatArray:
        """Slant content, TECU, for a vertical content of 1 TECU in the middle of the shells."""
        return np.asarray(1.0 / np.sqrt(1.0 - (self.shell_ratio * np.cos(self.elevation)) ** 2))


def make_sky(
    measured: SingleDifferences,
    geometry: Geometry,
    positions_itrf: FloatArray,
    positions: FloatArray,
    configuration: CdgpsConfiguration,
    rotations_body: FloatArray | None = None,
    attitudes: Attitudes = (None, None),
) -> Sky:
    """Return the sky of single differences.

    Parameters
    ----------
    measured : SingleDifferences
    geometry : Geometry
    positions_itrf, positions : ndarray, shape (2, 3)
        Positions of chief and deputy, ITRF and navigation axes, m.
    configuration : CdgpsConfiguration
    rotations_body : ndarray, shape (2, 3, 3), optional
        From the body axes of chief and deputy to the navigation axes, where antennas are given.
    attitudes : tuple of BodyAttitude or None
        Estimated attitudes that the rotations are those of.
    """
    height_chief, height_deputy = geodetic_from_itrf(positions_itrf)[:, 2].tolist()
    rise = height_deputy - height_chief
    columns = geometry.columns(measured.satellite)
    radius, heights = norm(positions_itrf[0]), configuration.plasma_shell_heights
    predicted, direction, direction_chief, range_rate, ray_turn, delay, elevation = sky_columns(
        columns,
        geometry.range,
        geometry.clock,
        geometry.range_rate,
        geometry.direction,
        geometry.elevation,
        positions,
        radius,
        rise,
        _column(configuration.plasma_layers),
        _column(heights),
        measured.frequency_hz,
    )
    troposphere = np.zeros(len(measured))
    if configuration.has_troposphere:
        predicted = predicted + troposphere_delay(positions_itrf[1], elevation[1])
        predicted = predicted - troposphere_delay(positions_itrf[0], elevation[0])
        zenith_sigma = math.hypot(
            configuration.troposphere_distance_sigma * norm(positions[1] - positions[0]),
            configuration.troposphere_height_sigma * rise,
        )
        troposphere = zenith_sigma * troposphere_mapping(elevation[1])
    antenna_offset, antennas = np.zeros((len(measured), 0)), configuration.antennas
    antenna_turn = antenna_offset
    if antennas is not None and rotations_body is not None:
        antenna_offset = antennas.offset_columns(direction, rotations_body)
        antenna_turn = antennas.attitude_columns(direction, rotations_body, attitudes)
    return make_table(
        Sky,
        predicted=predicted,
        direction=direction,
        direction_chief=direction_chief,
        clock_rate=1.0 - range_rate / SPEED_OF_LIGHT,
        plasma_delay=delay,
        shell_ratio=radius / (radius + sum(heights) / max(len(heights), 1)),
        elevation=elevation[0],
        azimuth=geometry.azimuth[0, columns],
        antenna_offset=antenna_offset,
        antenna_turn=antenna_turn,
        ray_turn=ray_turn,
        troposphere=troposphere,
    )


@functools.lru_cache(maxsize=16)
def _column(values: tuple[float, ...]) -> FloatArray:
    """Return numbers as an array, which is not written to."""
    return np.array(values, dtype=float)


def code_biases(state: GaussianState, measured: SingleDifferences) -> FloatArray:
    """Return the estimated receiver biases of the codes, m, shape (n,)."""
    labels = [("code_bias", group) for group in measured.keys.groups]
    biases = [state.value(label) if label in state else 0.0 for label in labels]
    return np.array(biases, dtype=float)[measured.keys.group_rows]


def measurement_innovation(
    state: GaussianState,
    arcs: ArcBook,
    measured: SingleDifferences,
    sky: Sky,
    clock: float,
    laser: LaserMeasurement | None = None,
) -> Innovation:
    """Return the innovation of n codes, n phases and the laser, in this order.

    Parameters
    ----------
    state : GaussianState
    arcs : ArcBook
        Arcs of all phases.
    measured : SingleDifferences
    sky : Sky
    clock : float
        Clock difference for which the sky was computed, m.
    laser : LaserMeasurement, optional
    """
    columns = arcs.columns(measured.keys, state)
    has_plasma = ("plasma", 0) in state
    plasma_columns = state.column_numbers(*PLASMA_KINDS) if has_plasma else _NO_COLUMNS
    plasma_delay = sky.plasma_delay if has_plasma else _NO_DERIVATIVES
    all_waves = state.column_numbers("plasma_wave") if has_plasma else _NO_COLUMNS
    antenna_columns, derivatives, totals = _antenna_errors(state, sky)
    design, values, variances, nuisance = model_differences(
        state.mean,
        state.find(CHIEF_MOTION[0]),
        sky.direction,
        sky.direction_chief,
        sky.predicted + clock,
        sky.clock_rate,
        plasma_columns,
        plasma_delay,
        plasma_delay @ state.mean[state.span(*PLASMA_KINDS)] if has_plasma else sky.predicted,
        all_waves,
        columns.wave_columns,
        _delay_of_tecu(measured) * sky.wave if len(all_waves) else sky.ray_turn,
        antenna_columns,
        derivatives,
        totals,
        state.find(("troposphere",)),
        sky.troposphere,
        columns.phase_columns,
        columns.code_columns,
        columns.slow_columns,
        columns.offset_columns,
        sky.ray_turn,
        columns.cycles,
        measured.wavelength,
        measured.noise_growth,
        measured.code,
        measured.phase,
        measured.code_variance,
        measured.phase_variance,
        0 if laser is None else 1,
    )
    if laser is not None:
        variances[-1] = laser.range_sigma**2 + _laser_curvature(state)
        values[-1] = laser.range - _laser_row(design[-1], state)
    return state.innovation(design, values, variances, nuisance)


def _antenna_errors(
    state: GaussianState, sky: Sky
) -> tuple[npt.NDArray[np.int64], FloatArray, FloatArray]:
    """Return the members of lever arms and attitudes, derivatives, and what they lengthen by.

    The derivatives, shape (n, k), are those of codes and phases alike. What lever arms and
    attitudes lengthen these by has shape (2, n), m.
    """
    count = len(sky.predicted)
    kinds = (("antenna_offset", sky.antenna_offset), ("attitude_error", sky.antenna_turn))
    members = [(kind, derivatives) for kind, derivatives in kinds if derivatives.shape[1]]
    if not members:
        return _NO_COLUMNS, _NO_DERIVATIVES, _NO_DERIVATIVES
    totals = np.zeros((2, count))
    for row, (kind, derivatives) in enumerate(members):
        totals[row] = derivatives @ state.mean[state.span(kind)]
    return (
        np.concatenate([state.column_numbers(kind) for kind, _ in members]),
        np.concatenate([derivatives for _, derivatives in members], axis=1),
        totals,
    )


def phase_waves(
    measured: SingleDifferences, sky: Sky, satellites: Sequence[tuple[int, int]]
) -> FloatArray:
    """Return the derivatives of phases by the waves of m satellites, m per TECU, shape (n, m)."""
    column = {satellite: index for index, satellite in enumerate(satellites)}
    derivatives = np.zeros((len(measured), len(satellites)))
    columns = [column[satellite] for satellite in measured.keys.satellites]
    derivatives[np.arange(len(measured)), columns] = -_delay_of_tecu(measured) * sky.wave
    return derivatives


def _delay_of_tecu(measured: SingleDifferences) -> FloatArray:
    """Return the delays of codes by 1 TECU, m, shape (n,)."""
    return np.asarray(DELAY_PER_TECU / measured.frequency_hz**2)


def _laser_row(design: FloatArray, state: GaussianState) -> float:
    """Fill the row of the laser in the design matrix; return the predicted measurement, m."""
    position, velocity = state.mean[:3], state.mean[3:6]
    distance = float(np.linalg.norm(position))
    along = position / distance
    rate = float(along @ velocity)
    latency_index = state.index(("laser_latency",))
    latency = float(state.mean[latency_index])
    design[:3] = along + latency * (velocity - rate * along) / distance
    design[3:6] = latency * along
    design[latency_index] = rate
    return distance + latency * rate


def _laser_curvature(state: GaussianState) -> float:
    """Return the variance of the second-order terms that the row of the laser leaves out, m2.

    While position and velocity are known to metres only, the curvature of the range and the
    product of the errors of latency and velocity are far above the noise of a laser. Without them
    the filter would trust a wrong latency for good.
    """
    variance = np.diagonal(state.covariance)
    across = float(variance[:3].sum()) / float(np.linalg.norm(state.mean[:3]))
    product = float(variance[3:6].sum() * variance[state.index(("laser_latency",))])
    return across**2 + product
