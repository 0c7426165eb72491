"""Linear measurement model of the relative filter for code, phase and laser range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray, norm
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.orbit_filter import CHIEF_MOTION
from vtff_nav.relative.cdgps.state import GaussianState, Innovation
from vtff_nav.relative.common.antenna_correction import Attitudes
from vtff_nav.relative.common.measurements import Geometry, SingleDifferences
from vtff_nav.relative.common.orbit_single_point import troposphere_delay, troposphere_mapping
from vtff_nav.relative.common.solution import LaserMeasurement
from vtff_nav.relative.kernels.sky import sky_columns

__all__ = [
    "PLASMA_KINDS",
    "Sky",
    "code_biases",
    "measurement_innovation",
    "make_sky",
    "phase_plasma",
    "phase_waves",
]

PLASMA_KINDS = ("plasma", "plasma_shell")
"""Kinds of the members of the plasma, in the order of the columns of `Sky.plasma`."""


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
    plasma : ndarray, shape (n, layers + 3 shells)
        Differential slant content, TECU, of each layer for a density of `DENSITY_UNIT`, and of
        each shell for 1 TECU and for gradients of 1 TECU/deg to north and to east.
    wave : ndarray
        Slant content, TECU, for a vertical content of 1 TECU in the middle of the shells.
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
    plasma: FloatArray
    wave: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    antenna_offset: FloatArray
    antenna_turn: FloatArray
    ray_turn: FloatArray
    troposphere: FloatArray

    def select(self, rows: npt.NDArray[np.intp]) -> Sky:
        """Return the sky of some of the single differences."""
        return Sky(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


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
    predicted, direction, direction_chief, range_rate, ray_turn, plasma, elevation = sky_columns(
        columns,
        geometry.range,
        geometry.clock,
        geometry.range_rate,
        geometry.direction,
        geometry.elevation,
        positions,
        norm(positions_itrf[0]),
        rise,
        np.array(configuration.plasma_layers),
        np.array(configuration.plasma_shell_heights),
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
    return Sky(
        predicted=predicted,
        direction=direction,
        direction_chief=direction_chief,
        clock_rate=1.0 - range_rate / SPEED_OF_LIGHT,
        plasma=plasma,
        wave=_obliquity(norm(positions_itrf[0]), elevation[0], configuration.plasma_shell_heights),
        elevation=elevation[0],
        azimuth=geometry.azimuth[0, columns],
        antenna_offset=antenna_offset,
        antenna_turn=antenna_turn,
        ray_turn=ray_turn,
        troposphere=troposphere,
    )


def _obliquity(radius: float, elevation: FloatArray, heights: Sequence[float]) -> FloatArray:
    """Return slant over vertical content on a shell in the middle of heights (m), shape (n,)."""
    shell = radius + sum(heights) / max(len(heights), 1)
    return np.asarray(1.0 / np.sqrt(1.0 - (radius / shell * np.cos(elevation)) ** 2))


def code_biases(state: GaussianState, measured: SingleDifferences) -> FloatArray:
    """Return the estimated receiver biases of the codes, m, shape (n,)."""
    return np.array(
        [
            state.value(("code_bias", key.group)) if ("code_bias", key.group) in state else 0.0
            for key in measured.keys
        ]
    )


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
    count = len(measured)
    size = 2 * count + (laser is not None)
    design = np.zeros((size, len(state)))
    code, phase = slice(0, count), slice(count, 2 * count)
    design[code, :3] = design[phase, :3] = -sky.direction
    if CHIEF_MOTION[0] in state:
        # Both antennas are off by the error of the chief's position, along different rays.
        first = state.index(CHIEF_MOTION[0])
        position = slice(first, first + 3)
        design[code, position] = design[phase, position] = sky.direction_chief - sky.direction
    predicted = np.empty(size)
    predicted[code] = predicted[phase] = sky.predicted + clock
    _add_plasma(design, predicted, state, measured, sky)
    _add_antennas(design, predicted, state, sky)
    _add_troposphere(design, predicted, state, sky)
    columns, code_columns, cycles = _bias_columns(state, arcs, measured)
    rows = np.arange(count)
    design[rows + count, columns] = 1.0
    _add_ray_turn(design, predicted, state, measured, sky)
    slow_errors = np.zeros(count)
    for row, key in enumerate(measured.keys) if state.columns("phase_error") else ():
        if ("phase_error", key) in state:
            slow = state.index(("phase_error", key))
            growth = measured.noise_growth[row]
            design[count + row, slow] = growth
            slow_errors[row] = growth * state.mean[slow]
    has_bias = code_columns >= 0
    design[rows[has_bias], code_columns[has_bias]] = 1.0
    predicted[code] += np.where(has_bias, state.mean[code_columns], 0.0)
    predicted[phase] += state.mean[columns] + slow_errors + cycles * measured.wavelength
    values = np.empty(size)
    values[code], values[phase] = measured.code, measured.phase
    variances = np.empty(size)
    variances[code], variances[phase] = measured.code_variance, measured.phase_variance
    nuisance = np.zeros((size, min(count, 1)))
    if count:
        nuisance[code, 0] = nuisance[phase, 0] = sky.clock_rate
    if laser is not None:
        values[-1] = laser.range
        variances[-1] = laser.range_sigma**2 + _laser_curvature(state)
        predicted[-1] = _laser_row(design[-1], state)
    return state.innovation(design, values - predicted, variances, nuisance)


def phase_plasma(measured: SingleDifferences, sky: Sky) -> FloatArray:
    """Return the derivatives of phases by the members of the plasma, m, shape (n, members)."""
    return np.asarray(-_delay_of_tecu(measured)[:, None] * sky.plasma)


def phase_waves(
    measured: SingleDifferences, sky: Sky, satellites: Sequence[tuple[int, int]]
) -> FloatArray:
    """Return the derivatives of phases by the waves of m satellites, m per TECU, shape (n, m)."""
    column = {satellite: index for index, satellite in enumerate(satellites)}
    derivatives = np.zeros((len(measured), len(satellites)))
    columns = [column[key.satellite] for key in measured.keys]
    derivatives[np.arange(len(measured)), columns] = -_delay_of_tecu(measured) * sky.wave
    return derivatives


def _delay_of_tecu(measured: SingleDifferences) -> FloatArray:
    """Return the delays of codes by 1 TECU, m, shape (n,)."""
    return np.asarray(IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU / measured.frequency_hz**2)


def _add_plasma(
    design: FloatArray,
    predicted: FloatArray,
    state: GaussianState,
    measured: SingleDifferences,
    sky: Sky,
) -> None:
    """Add the ionosphere, which delays codes and advances phases."""
    if ("plasma", 0) not in state:
        return
    count = len(measured)
    delay = -phase_plasma(measured, sky)
    columns = state.span(*PLASMA_KINDS)
    design[:count, columns] = delay
    design[count : 2 * count, columns] = -delay
    total = delay @ state.mean[columns]
    if state.columns("plasma_wave"):
        columns = state.columns("plasma_wave")
        satellites = [satellite for _, satellite in state.labels_of("plasma_wave")]
        delay = -phase_waves(measured, sky, satellites)
        design[:count, columns] = delay
        design[count : 2 * count, columns] = -delay
        total += delay @ state.mean[columns]
    predicted[:count] += total
    predicted[count : 2 * count] -= total


def _add_antennas(
    design: FloatArray, predicted: FloatArray, state: GaussianState, sky: Sky
) -> None:
    """Add the errors of lever arms and of attitudes, which lengthen codes and phases alike."""
    for kind, derivatives in (
        ("antenna_offset", sky.antenna_offset),
        ("attitude_error", sky.antenna_turn),
    ):
        count, members = derivatives.shape
        if not members:
            continue
        columns = state.span(kind)
        for rows in (slice(0, count), slice(count, 2 * count)):
            design[rows, columns] = derivatives
            predicted[rows] += derivatives @ state.mean[columns]


def _add_troposphere(
    design: FloatArray, predicted: FloatArray, state: GaussianState, sky: Sky
) -> None:
    """Add what the model of the troposphere leaves, which delays codes and phases alike."""
    if ("troposphere",) not in state:
        return
    count, column = len(sky.troposphere), state.index(("troposphere",))
    for rows in (slice(0, count), slice(count, 2 * count)):
        design[rows, column] = sky.troposphere
        predicted[rows] += sky.troposphere * state.mean[column]


def _add_ray_turn(
    design: FloatArray,
    predicted: FloatArray,
    state: GaussianState,
    measured: SingleDifferences,
    sky: Sky,
) -> None:
    """Add the errors of satellites across their rays, which turn these."""
    if not state.columns("satellite_offset"):
        return
    count = len(measured)
    for row, key in enumerate(measured.keys):
        label = ("satellite_offset", key.satellite)
        if label in state:
            column, turn = state.index(label), sky.ray_turn[row]
            design[[row, count + row], column] = turn
            predicted[[row, count + row]] += turn * state.mean[column]


def _bias_columns(
    state: GaussianState, arcs: ArcBook, measured: SingleDifferences
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray]:
    """Return the columns of phase and code biases, and the known cycles of the phases.

    Returns
    -------
    columns : ndarray of intp, shape (n,)
        Column of the ambiguity of each phase, or of the bias of its group if it has an integer.
    code_columns : ndarray of intp, shape (n,)
        Column of the bias of each code; -1 for codes of the reference group.
    cycles : ndarray, shape (n,)
        Offset and integer of each phase.
    """
    columns, code_columns, cycles = [], [], []
    code_biases, phase_biases = (
        {label[1]: state.index(label) for label in state.labels_of(kind)}
        for kind in ("code_bias", "phase_bias")
    )
    for key in measured.keys:
        arc, group = arcs[key], key.group
        phase_cycles = arc.offset_cycles
        if arc.integer is None:
            columns.append(state.index(("ambiguity", key)))
        else:
            columns.append(phase_biases[group])
            phase_cycles += arc.integer
        cycles.append(phase_cycles)
        code_columns.append(code_biases.get(group, -1))
    return (
        np.array(columns, dtype=np.intp),
        np.array(code_columns, dtype=np.intp),
        np.array(cycles),
    )


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
