"""The ionosphere that two spacecraft observe together, second by second.

Each second brings the observations of both receivers since the second before, their positions, and
the integers that relative navigation has fixed. The results are the contents and the scintillation
of each spacecraft (`vtff_iono.spacecraft.spacecraft_ionosphere`), the electron density between the
two (`vtff_iono.density.formation_density`), and the edges of irregularities that they cross
(`vtff_iono.edges`).
"""

from __future__ import annotations

from dataclasses import dataclass

from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_iono.bias.code_biases import CodeBiasTable
from vtff_iono.density.electron_density import DensitySettings
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

__all__ = ["FormationIonosphere", "FormationResult", "FormationSettings"]


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
        Results of chief and deputy.
    density : tuple of DensityResult
        Densities of the seconds that have ended, as a rule one. A second ends with the first sample
        of the next one.
    boundaries : tuple of Boundary
        Edges that this second has confirmed.
    """

    spacecraft: tuple[SpacecraftResult, SpacecraftResult]
    density: tuple[DensityResult, ...]
    boundaries: tuple[Boundary, ...]


class FormationIonosphere:
    """Contents, scintillation and electron density of two spacecraft.

    Parameters
    ----------
    settings : FormationSettings
    code_biases : CodeBiasTable, optional
        Satellite biases; by default those that the ephemerides contain.

    Attributes
    ----------
    spacecraft : tuple of SpacecraftIonosphere
        The processing of chief and deputy.
    """

    def __init__(
        self,
        settings: FormationSettings = FormationSettings(),  # noqa: B008 - frozen
        code_biases: CodeBiasTable | None = None,
    ) -> None:
        self.spacecraft = (
            SpacecraftIonosphere(settings.spacecraft, code_biases),
            SpacecraftIonosphere(settings.spacecraft, code_biases),
        )
        self._tracks = (Track(), Track())
        self._density = FormationDensity(
            settings.density, settings.density_bands, settings.carrier_phase_sigma
        )
        self._ray_edges = (
            RayEdgeFinder(0, settings.ray_edges),
            RayEdgeFinder(1, settings.ray_edges),
        )
        self._vertical_edges = VerticalEdgeFinder()

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Add a broadcast ephemeris that either receiver has decoded."""
        for spacecraft in self.spacecraft:
            spacecraft.add_ephemeris(ephemeris)

    def process(self, second: FormationSecond) -> FormationResult:
        """Process the next second and return its results."""
        tracks, positions, results = [], [], []
        for craft, spacecraft in enumerate(self.spacecraft):
            track = self._tracks[craft].followed_by(second.time, second.states_itrf[craft])
            block = second.observations[craft]
            position = track.positions(block.time)
            tracks.append(track)
            positions.append(position)
            results.append(spacecraft.process(block, position))
        self._tracks = (tracks[0], tracks[1])
        both_results = (results[0], results[1])
        links = (self.spacecraft[0].links, self.spacecraft[1].links)
        densities = self._density.update(second, both_results, links, self._tracks)
        boundaries: list[Boundary] = []
        for finder, block, position, result in zip(
            self._ray_edges, second.observations, positions, results, strict=True
        ):
            boundaries += finder.update(block, position, result)
        boundaries += self._vertical_edges.update(
            (positions[0], positions[1]), both_results, links, densities
        )
        return FormationResult(both_results, tuple(densities), tuple(boundaries))
