"""Effects of the ionosphere on the signals of one receiver: slant TEC and scintillation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.line_of_sight import LineOfSight
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile
from vtff_sim_bridge.atmosphere.horizontal_structure import (
    HorizontalGradient,
    HorizontalStructure,
    TravellingDisturbance,
)
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion, path_length_in_region
from vtff_sim_bridge.atmosphere.scintillation import (
    AlongTrackAxis,
    ScintillationField,
    s4_at_frequency,
    scintillation_gain,
    tapered_s4,
)
from vtff_sim_bridge.atmosphere.slant_tec import SlantTecIntegrator
from vtff_sim_bridge.noise.random_streams import Effect

__all__ = ["Ionosphere", "RegionCrossing", "ScintillatedLinks"]


@dataclass(frozen=True, eq=False)
class RegionCrossing:
    """Rays of a second that cross one region: S4 on L1 and scattered part, shape (k, n)."""

    s4_l1: FloatArray
    fluctuation: npt.NDArray[np.complex128]


class Ionosphere:
    """Ionosphere of a run, shared by its receivers.

    Parameters
    ----------
    profile : ElectronDensityProfile or None
        Electron density against altitude.
    regions : sequence of IrregularityRegion
    seed : int
        Seed of the run.
    state_itrf : array_like, shape (6,)
        Position (m) and velocity (m/s) of the first vehicle at the start, which gives the
        coordinate along the track on which all receivers see the same pattern.
    structures : sequence of HorizontalGradient or TravellingDisturbance
        What the profile, which is the same everywhere, does not have.

    Raises
    ------
    ValueError
        If a structure is not above the vehicle.
    """

    def __init__(
        self,
        profile: ElectronDensityProfile | None,
        regions: Sequence[IrregularityRegion],
        seed: int,
        state_itrf: npt.ArrayLike,
        structures: Sequence[HorizontalGradient | TravellingDisturbance] = (),
    ) -> None:
        self._integrator = None if profile is None else SlantTecIntegrator(profile)
        self._regions = tuple(regions)
        self._seed = seed
        # Patterns by number of the region and of the receiver; None: of all receivers.
        self._fields: dict[tuple[int, int | None], ScintillationField] = {}
        self._axis = AlongTrackAxis(state_itrf) if regions else None
        state = np.asarray(state_itrf, dtype=float)
        normal = np.cross(state[:3], state[3:])
        rate = float(np.linalg.norm(normal)) / float(state[:3] @ state[:3])
        self._structure = None
        if structures:
            self._structure = HorizontalStructure(structures, seed, state[:3])
        self._period = 2.0 * math.pi / rate if rate > 0.0 else math.inf

    def slant_tec_tecu(
        self, line_of_sight: LineOfSight, position_itrf: FloatArray, elapsed: FloatArray
    ) -> FloatArray:
        """Return the slant TEC of all rays, TECU, shape (k, n), at times into the run (k,)."""
        tecu = np.zeros(line_of_sight.range.shape)
        if self._integrator is not None:
            tecu = self._integrator.slant_tec_tecu(
                position_itrf, line_of_sight.position_satellite_itrf
            )
        if self._structure is not None:
            tecu = tecu + self._structure.slant_tec_tecu(
                position_itrf, line_of_sight.direction_itrf, elapsed
            )
            # A trough cannot have less than no electrons.
            tecu = np.maximum(tecu, 0.0)
        return tecu

    def crossings(
        self,
        line_of_sight: LineOfSight,
        position_itrf: FloatArray,
        time: GpsTime,
        elapsed: FloatArray,
        stream: npt.NDArray[np.integer],
        receiver: int,
    ) -> list[RegionCrossing]:
        """Return the scintillation of rays in each region that they cross.

        Parameters
        ----------
        line_of_sight : LineOfSight
            Shape (k, n).
        position_itrf : ndarray, shape (k, 3)
        time : GpsTime
            At which local time becomes longitude.
        elapsed : ndarray, shape (k,)
            Time into the run, s: tells in which revolution the receiver is.
        stream : ndarray of int, shape (n,)
            Number of the pattern of each satellite.
        receiver : int
            Number of the receiver in seeds: that of the pattern that is not common to all.
        """
        crossings: list[RegionCrossing] = []
        for number, region in enumerate(self._regions):
            position, satellite = position_itrf, line_of_sight.position_satellite_itrf
            of_longitude = time
            if region.drift_east is not None:
                # In axes that go with the plasma, the region is where it was at the start.
                angle = region.drift_angle(elapsed)
                position, satellite = _turn_west(position, angle), _turn_west(satellite, angle)
                of_longitude = time - float(elapsed[-1])
            length = path_length_in_region(region, of_longitude, position[:, None], satellite)
            if self._axis is None or not length.any():
                continue
            along = self._axis.coordinate(position)
            along = along + self._period * np.round((elapsed - along) / self._period)
            fluctuation = self._fluctuation(number, receiver, stream[None, :], along[:, None])
            s4 = tapered_s4(region.s4, length, region.taper_length)
            crossings.append(RegionCrossing(s4, fluctuation))
        return crossings

    def _fluctuation(
        self,
        number: int,
        receiver: int,
        stream: npt.NDArray[np.integer],
        along: FloatArray,
    ) -> npt.NDArray[np.complex128]:
        """Return the scattered parts of a region: what all receivers meet, and what one does."""
        common = self._field(number, None).fluctuation(stream, along)
        correlation = self._regions[number].correlation
        if correlation == 1.0:
            return common
        own = self._field(number, receiver).fluctuation(stream, along)
        return np.asarray(math.sqrt(correlation) * common + math.sqrt(1.0 - correlation) * own)

    def _field(self, number: int, receiver: int | None) -> ScintillationField:
        """Return the pattern of a region that all receivers share, or that one has for itself."""
        field = self._fields.get((number, receiver))
        if field is None:
            of_receiver = () if receiver is None else (receiver,)
            field = self._fields[number, receiver] = ScintillationField(
                self._regions[number].decorrelation_time,
                (self._seed, Effect.SCINTILLATION, number, *of_receiver),
            )
        return field


def _turn_west(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """Return vectors in ITRF (k, ..., 3) turned west about the polar axis by angles (k,), rad."""
    sine, cosine = (
        function(angle).reshape(-1, *[1] * (vectors.ndim - 2)) for function in (np.sin, np.cos)
    )
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack((cosine * x + sine * y, cosine * y - sine * x, z), axis=-1)


class ScintillatedLinks:
    """Amplitude and phase scintillation of the links of one receiver, phase without jumps.

    Parameters
    ----------
    frequency : ndarray, shape (links,)
        Hz, of all links.

    Attributes
    ----------
    has_slipped : bool
        Whether any link has slipped in a fade; told by `calm`.
    """

    def __init__(self, frequency: FloatArray) -> None:
        self._frequency = frequency
        self._phase: FloatArray = np.zeros(len(frequency))
        self._is_calm = True
        self.has_slipped = False

    def second(
        self,
        crossings: Sequence[RegionCrossing],
        satellite: npt.NDArray[np.intp],
        row: npt.NDArray[np.intp],
        emitted: slice,
    ) -> tuple[FloatArray, FloatArray]:
        """Return amplitude (a factor) and phase (rad) of links, shape (k, links asked for).

        Parameters
        ----------
        crossings : sequence of RegionCrossing
            At least one.
        satellite, row : ndarray of int
            Column of each link in the crossings, and its row among all links.
        emitted : slice
            Epochs that are measured now: only these lead the phase on.
        """
        gain = np.ones((len(crossings[0].s4_l1), len(satellite)), dtype=complex)
        for crossing in crossings:
            s4 = s4_at_frequency(crossing.s4_l1[:, satellite], self._frequency[row])
            gain *= scintillation_gain(crossing.fluctuation[:, satellite], s4)
        self._is_calm = False
        phase = np.angle(gain)
        turn = 2.0 * math.pi
        last = self._phase[row]
        for index in range(*emitted.indices(len(phase))):
            phase[index] += turn * np.round((last - phase[index]) / turn)
            last = phase[index]
        self._phase[row] = last
        return np.abs(gain), phase

    def calm(self) -> None:
        """Leave the regions: keep only the whole cycles that have slipped in fades.

        The phase then has no fractional part, so that it does not jump when a ray enters a region.
        """
        if not self._is_calm:
            self._phase = 2.0 * math.pi * np.round(self._phase / (2.0 * math.pi))
            self._is_calm, self.has_slipped = True, bool(self._phase.any())

    @property
    def settled_phase(self) -> FloatArray:
        """Phase left behind by cycles that slipped in fades, rad, shape (links,)."""
        return self._phase
