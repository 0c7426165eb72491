"""Linear measurement model of the relative filter for code, phase and laser range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray, cross, norm
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_nav.relative.cdgps.ambiguity_arcs import ArcBook
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.orbit_filter import CHIEF_MOTION
from vtff_nav.relative.cdgps.state import GaussianState, Innovation
from vtff_nav.relative.common.antenna_correction import Attitudes
from vtff_nav.relative.common.measurements import Geometry, SingleDifferences
from vtff_nav.relative.common.orbit_single_point import troposphere_delay, troposphere_mapping
from vtff_nav.relative.common.solution import LaserMeasurement

__all__ = [
    "DENSITY_UNIT",
    "PLASMA_KINDS",
    "Sky",
    "code_biases",
    "measurement_innovation",
    "make_sky",
    "north_and_east",
    "phase_plasma",
    "plasma_paths",
    "shell_paths",
]

PLASMA_KINDS = ("plasma", "plasma_shell")
"""Kinds of the members of the plasma, in the order of the columns of `Sky.plasma`."""

DENSITY_UNIT = 1e12
"""Electrons per m3 in the unit of the states ``("plasma", layer)``."""


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
    columns = geometry.columns(measured.satellite)
    height_chief, height_deputy = geodetic_from_itrf(positions_itrf)[:, 2].tolist()
    elevation = geometry.elevation[:, columns]
    ranges = geometry.range[1] - geometry.range[0]
    predicted = (ranges - geometry.clock[1] + geometry.clock[0])[columns]
    troposphere = np.zeros(len(measured))
    if configuration.has_troposphere:
        predicted = predicted + troposphere_delay(positions_itrf[1], elevation[1])
        predicted = predicted - troposphere_delay(positions_itrf[0], elevation[0])
        zenith_sigma = math.hypot(
            configuration.troposphere_distance_sigma * norm(positions[1] - positions[0]),
            configuration.troposphere_height_sigma * (height_deputy - height_chief),
        )
        troposphere = zenith_sigma * troposphere_mapping(elevation[1])
    direction = geometry.direction[1, columns]
    antenna_offset, antennas = np.zeros((len(measured), 0)), configuration.antennas
    antenna_turn = antenna_offset
    if antennas is not None and rotations_body is not None:
        antenna_offset = antennas.offset_columns(direction, rotations_body)
        antenna_turn = antennas.attitude_columns(direction, rotations_body, attitudes)
    baseline = positions[1] - positions[0]
    along = direction @ baseline
    across = np.sqrt(np.maximum(baseline @ baseline - along**2, 0.0))
    return Sky(
        predicted=predicted,
        direction=direction,
        direction_chief=geometry.direction[0, columns],
        clock_rate=1.0 - geometry.range_rate[1, columns] / SPEED_OF_LIGHT,
        plasma=np.hstack(
            (
                plasma_paths(
                    float(np.linalg.norm(positions_itrf[0])),
                    height_deputy - height_chief,
                    elevation,
                    configuration.plasma_layers,
                ),
                shell_paths(
                    positions, geometry.direction[:, columns], configuration.plasma_shell_heights
                ),
            )
        ),
        elevation=elevation[0],
        azimuth=geometry.azimuth[0, columns],
        antenna_offset=antenna_offset,
        antenna_turn=antenna_turn,
        ray_turn=across / geometry.range[1, columns],
        troposphere=troposphere,
    )


def plasma_paths(
    radius: float, rise: float, elevation: FloatArray, layers: Sequence[float]
) -> FloatArray:
    """Return the differential slant content of layers of constant density, shape (n, layers).

    Parameters
    ----------
    radius : float
        Distance of the chief from the centre of the Earth, m.
    rise : float
        Height of the deputy above the chief, m.
    elevation : ndarray, shape (2, n)
        Elevation at chief and deputy, rad.
    layers : sequence of float
        Thicknesses of the layers above the chief, m.

    Returns
    -------
    ndarray
        TECU for a density of `DENSITY_UNIT`: ``sqrt((R + L)^2 - (r cos E)^2) - r sin E``, deputy
        less chief.

    Notes
    -----
    This is the whole effect of a spherical layer that reaches below both receivers. One part is the
    path between the two altitudes, ``-rise / sin E``, which is all at high elevations. The other
    part comes from the path above, which differs because elevation and altitude do. Four layers
    reproduce Chapman and constant profiles above 5 deg to 0.1 mTECU at 250 m and 2 mTECU at 5 km;
    the plane slab alone is wrong by 75 mTECU.
    """
    receiver = np.array([[radius], [radius + rise]])
    perigee_squared = (receiver * np.cos(elevation)) ** 2
    down = receiver * np.sin(elevation)
    columns = []
    for thickness in layers:
        path = np.sqrt((radius + thickness) ** 2 - perigee_squared) - down
        columns.append(path[1] - path[0])
    return np.asarray(np.array(columns).T * (DENSITY_UNIT / ELECTRONS_PER_TECU))


def shell_paths(
    positions: FloatArray, direction: FloatArray, heights: Sequence[float]
) -> FloatArray:
    """Return the differential slant content of shells whose content differs from place to place.

    Parameters
    ----------
    positions : ndarray, shape (2, 3)
        Chief and deputy, m; the third axis is that of the Earth.
    direction : ndarray, shape (2, n, 3)
        Unit vectors to the satellites, same axes.
    heights : sequence of float
        Heights of the shells above the chief, m.

    Returns
    -------
    ndarray, shape (n, 3 shells)
        TECU, deputy less chief, of each shell: for a vertical content of 1 TECU everywhere, and for
        one that grows by 1 TECU/deg to north or to east from zero above the chief. The vertical
        content is divided by the sine of the elevation where a ray pierces the shell (single-layer
        model, Schaer 1999, section 2.3.3).
    """
    axes = north_and_east(positions[0])
    radius = np.sqrt(np.einsum("ri,ri->r", positions, positions))[:, None, None]
    up = (direction @ positions[:, :, None]) / radius
    shell = radius[0, 0, 0] + np.array(heights)
    up_there = np.sqrt(1.0 - (radius / shell) ** 2 * (1.0 - up**2))
    distance = shell * up_there - radius * up
    # Receiver and ray along north and east: their sum is where the ray pierces the shell.
    receiver, ray = positions @ axes.T, direction @ axes.T
    pierce = receiver[:, None, None] + distance[..., None] * ray[:, :, None]
    content = np.ones((*distance.shape, 3))
    content[..., 1:] = np.degrees(np.arcsin(np.clip(pierce / shell[:, None], -1.0, 1.0)))
    content /= up_there[..., None]
    return np.asarray((content[1] - content[0]).reshape(direction.shape[1], -1))


def north_and_east(position: FloatArray) -> FloatArray:
    """Return unit vectors to north and east at a position, shape (2, 3), in its axes.

    The third axis is that of the Earth; at the poles, where there is no north, east is zero.
    """
    zenith = position / np.linalg.norm(position)
    east = np.array([-zenith[1], zenith[0], 0.0])
    east /= max(float(np.linalg.norm(east)), 1e-6)
    return np.array([cross(zenith, east), east])


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
    scale = IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU / measured.frequency_hz**2
    return np.asarray(-scale[:, None] * sky.plasma)


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
    columns = state.columns(*PLASMA_KINDS)
    design[:count, columns] = delay
    design[count : 2 * count, columns] = -delay
    total = delay @ state.mean[columns]
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
        columns = state.columns(kind)
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
