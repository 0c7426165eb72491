"""The ionosphere that the spacecraft of a formation observe together, second by second.

Each second brings the observations of all receivers since the second before, their positions, and
the integers that relative navigation has fixed. The results are the contents and the scintillation
of each spacecraft (`vtff_iono.spacecraft.spacecraft_ionosphere`), and for each deputy the electron
density between it and the chief (`vtff_iono.density.formation_density`) and the edges of
irregularities that the two cross (`vtff_iono.edges`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_iono.bias.code_biases import CodeBiasTable
from vtff_iono.density.filter.settings import DensitySettings
from vtff_iono.density.formation_density import DensityResult, FormationDensity
from vtff_iono.edges.boundary import Boundary
from vtff_iono.edges.ray_edges import RayEdgeFinder, RayEdgeSettings
from vtff_iono.edges.vertical_edges import VerticalEdgeFinder
from vtff_iono.spacecraft.formation_second import FormationSecond, Track
from vtff_iono.spacecraft.spacecraft_ionosphere import (
    SpacecraftIonosphere,
    SpacecraftResult,
    SpacecraftSettings,
)

__all__ = [
    "SECONDS_TOGETHER",
    "FormationIonosphere",
    "FormationResult",
    "FormationSettings",
]

SECONDS_TOGETHER = 60
"""Seconds of a recording that are computed at once: more save little and fill the caches."""


@dataclass(frozen=True)
class FormationSettings:
    """Settings of the processing of a formation.

    Elevation masks: `SlantTecSettings.elevation_mask` and `DensitySettings.elevation_mask`, which
    the node sets from its `elevation_mask_deg`, and `RayEdgeSettings.elevation_mask`.

    Parameters
    ----------
    spacecraft : SpacecraftSettings
        Settings of the processing of each spacecraft.
    density : DensitySettings
    ray_edges : RayEdgeSettings
    density_bands : tuple of int
        RINEX frequency digits of the GPS signals that the density is computed from.
    carrier_phase_sigma : float
        Noise of one carrier phase of one receiver at the full rate, m.
    """

    spacecraft: SpacecraftSettings = SpacecraftSettings()
    density: DensitySettings = DensitySettings()
    ray_edges: RayEdgeSettings = RayEdgeSettings()
    density_bands: tuple[int, int] = (1, 2)
    carrier_phase_sigma: float = 0.001


@dataclass(frozen=True, eq=False)
class FormationResult:
    """Results of one second.

    Parameters
    ----------
    spacecraft : tuple of SpacecraftResult
        Results of the chief and each deputy.
    density : tuple of tuple of DensityResult
        For each deputy, densities of the seconds that have ended, as a rule one. A second ends with
        the first sample of the next one.
    boundaries : tuple of tuple of Boundary
        For each deputy, edges of its pair that this second has confirmed; an edge that the chief
        has seen is in every pair. `Boundary.spacecraft` is 0 for the chief, 1 for the deputy.
    """

    spacecraft: tuple[SpacecraftResult, ...]
    density: tuple[tuple[DensityResult, ...], ...]
    boundaries: tuple[tuple[Boundary, ...], ...]


class FormationIonosphere:
    """Contents, scintillation and electron density of a formation.

    Parameters
    ----------
    settings : FormationSettings
    code_biases : CodeBiasTable, optional
        Satellite biases; by default those that the ephemerides contain.
    number_of_deputies : int

    Attributes
    ----------
    spacecraft : tuple of SpacecraftIonosphere
        The processing of the chief and each deputy.
    """

    def __init__(
        self,
        settings: FormationSettings = FormationSettings(),  # noqa: B008 - frozen
        code_biases: CodeBiasTable | None = None,
        number_of_deputies: int = 1,
    ) -> None:
        count = number_of_deputies + 1
        self.spacecraft = tuple(
            SpacecraftIonosphere(settings.spacecraft, code_biases) for _ in range(count)
        )
        self._tracks = [Track() for _ in range(count)]
        self._ray_edges = [
            RayEdgeFinder(min(craft, 1), settings.ray_edges) for craft in range(count)
        ]
        self._density = [
            FormationDensity(settings.density, settings.density_bands, settings.carrier_phase_sigma)
            for _ in range(number_of_deputies)
        ]
        self._vertical_edges = [VerticalEdgeFinder() for _ in range(number_of_deputies)]

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Add a broadcast ephemeris that any receiver has decoded."""
        for spacecraft in self.spacecraft:
            spacecraft.add_ephemeris(ephemeris)

    def process(self, second: FormationSecond) -> FormationResult:
        """Process the next second and return its results."""
        (result,) = self._process_seconds((second,))
        return result

    def process_recording(
        self, recording: Iterable[tuple[Iterable[BroadcastEphemeris], FormationSecond]]
    ) -> Iterator[FormationResult]:
        """Process seconds that are there already, and yield the result of each.

        The results are those of `process`, for a fraction of the time: what does not depend on the
        results of the second before is computed for `SECONDS_TOGETHER` seconds at once.

        Parameters
        ----------
        recording : iterable of (iterable of BroadcastEphemeris, FormationSecond)
            Each second and the ephemerides that came with it.
        """
        together: list[FormationSecond] = []
        for ephemerides, second in recording:
            new = list(ephemerides)
            if together and (new or len(together) == SECONDS_TOGETHER):
                yield from self._process_seconds(together)
                together = []
            for ephemeris in new:
                self.add_ephemeris(ephemeris)
            together.append(second)
        if together:
            yield from self._process_seconds(together)

    def _process_seconds(self, seconds: Sequence[FormationSecond]) -> list[FormationResult]:
        """Process one or more seconds and return their results."""
        tracks: list[list[Track]] = []
        positions: list[list[FloatArray]] = []
        results: list[list[SpacecraftResult]] = []
        ray_edges: list[list[list[Boundary]]] = []
        for craft, spacecraft in enumerate(self.spacecraft):
            tracks.append([])
            positions.append([])
            blocks = [second.observations[craft] for second in seconds]
            for second, block in zip(seconds, blocks, strict=True):
                track = self._tracks[craft].followed_by(second.time, second.states_itrf[craft])
                self._tracks[craft] = track
                tracks[craft].append(track)
                positions[craft].append(track.positions(block.time))
            series = spacecraft.process(blocks, np.concatenate(positions[craft]))
            results.append(series.results)
            ray_edges.append(self._ray_edges[craft].update(series))
        return [
            self._result_of_pairs(
                second,
                tuple(of_craft[number] for of_craft in tracks),
                tuple(of_craft[number] for of_craft in positions),
                tuple(of_craft[number] for of_craft in results),
                tuple(of_craft[number] for of_craft in ray_edges),
            )
            for number, second in enumerate(seconds)
        ]

    def _result_of_pairs(
        self,
        second: FormationSecond,
        tracks: tuple[Track, ...],
        positions: tuple[FloatArray, ...],
        results: tuple[SpacecraftResult, ...],
        ray_edges: tuple[list[Boundary], ...],
    ) -> FormationResult:
        """Return the results of a second from those of each spacecraft."""
        densities: list[tuple[DensityResult, ...]] = []
        boundaries: list[tuple[Boundary, ...]] = []
        for deputy, (density, vertical_edges) in enumerate(
            zip(self._density, self._vertical_edges, strict=True)
        ):
            craft = deputy + 1
            pair_results = (results[0], results[craft])
            links = (self.spacecraft[0].links, self.spacecraft[craft].links)
            pair_densities = density.update(
                second.pair(deputy), pair_results, links, (tracks[0], tracks[craft])
            )
            edges = vertical_edges.update(
                (positions[0], positions[craft]), pair_results, links, pair_densities
            )
            densities.append(tuple(d for d in pair_densities if not d.is_late))
            boundaries.append((*ray_edges[0], *ray_edges[craft], *edges))
        return FormationResult(results, tuple(densities), tuple(boundaries))
