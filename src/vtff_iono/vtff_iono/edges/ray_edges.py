"""Horizontal edges of irregularities, found ray by ray while the rays of a spacecraft cross them.

Three quantities of a ray show each second whether it crosses an irregularity
(`vtff_iono.edges.ray_quantities`). An edge is where one of them rises above its threshold and
stays, or falls below it and stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import satellite_number
from vtff_iono.edges.boundary import Boundary, BoundaryKind, BoundarySource
from vtff_iono.edges.edge_detectors import Edge, ExceedanceDetector, edge_position
from vtff_iono.edges.ray_quantities import (
    ContentRates,
    RayGroups,
    RayQuantities,
    variance_ratios,
)
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftSeries

__all__ = ["RayEdgeFinder", "RayEdgeSettings"]


@dataclass(frozen=True)
class RayEdgeSettings:
    """Thresholds above which a ray crosses an irregularity.

    Parameters
    ----------
    variance_ratio : float
        Variance of the intensity in a second relative to that of noise. Without scintillation one
        second in a thousand exceeds 2.1, with an S4 of 0.4 nine in ten do.
    roti_tecu_per_minute : float
        Standard deviation of the rate of TEC over 5 s, TECU/min.
    gradient_tecu_per_km : float
        Mean gradient of TEC along the path of the spacecraft over 5 s, TECU/km.
    irregularity_altitude : float
        Altitude at which rays are taken to meet an irregularity, m; for a spacecraft above it, the
        altitude of the spacecraft.
    elevation_mask : float
        Lowest elevation of rays whose intensity is looked at, rad.
    rate_elevation_mask : float
        Lowest elevation of rays whose rate of TEC is looked at, rad. The rates of low rays change
        with their mapping, which is not known well enough.
    """

    variance_ratio: float = 2.5
    roti_tecu_per_minute: float = 2.0
    gradient_tecu_per_km: float = 0.05
    irregularity_altitude: float = 320e3
    elevation_mask: float = 0.0
    rate_elevation_mask: float = math.radians(25.0)


class RayEdgeFinder:
    """Finds the edges that the rays of one spacecraft cross.

    Parameters
    ----------
    spacecraft : int
        Number of the spacecraft in the edges: 0 chief, 1 deputy.
    settings : RayEdgeSettings
    """

    def __init__(
        self,
        spacecraft: int,
        settings: RayEdgeSettings = RayEdgeSettings(),  # noqa: B008 - frozen
    ) -> None:
        self._spacecraft = spacecraft
        self._settings = settings
        self._thresholds = {
            BoundarySource.S4: settings.variance_ratio,
            BoundarySource.ROTI: settings.roti_tecu_per_minute,
            BoundarySource.TEC_GRADIENT: settings.gradient_tecu_per_km,
        }
        # By system and PRN of the satellite and by quantity.
        self._detectors: dict[tuple[int, int, BoundarySource], ExceedanceDetector] = {}
        self._rates = ContentRates(settings.rate_elevation_mask)

    def update(self, series: SpacecraftSeries) -> list[list[Boundary]]:
        """Process the next seconds and return the edges that each of them confirms.

        Parameters
        ----------
        series : SpacecraftSeries
            Observations and results of the spacecraft, a block for each second.
        """
        groups = RayGroups.of(series)
        boundaries: list[list[Boundary]] = [[] for _ in series.results]
        observations = series.rows.pairs.row_first[groups.last_rows()]
        columns = series.block.columns
        for group, source, value in self._telling_quantities(series, groups, observations):
            observation, number = int(observations[group]), int(groups.second[group])
            system, prn = int(columns["system"][observation]), int(columns["prn"][observation])
            detector = self._detectors.get((system, prn, source))
            if detector is None:
                detector = ExceedanceDetector(self._thresholds[source])
                self._detectors[system, prn, source] = detector
            time = int(series.rows.pairs.time[series.first_row[number + 1] - 1])
            for edge in detector.update(time / NANOSECONDS_PER_SECOND, value):
                position = series.position_itrf[observation]
                direction = series.results[number].direction_itrf[
                    observation - int(series.first_observation[number])
                ]
                if np.isfinite(position).all() and np.isfinite(direction).all():
                    boundaries[number].append(
                        self._boundary(source, system, prn, edge, position, direction)
                    )
        return boundaries

    def _telling_quantities(
        self, series: SpacecraftSeries, groups: RayGroups, observations: npt.NDArray[np.int64]
    ) -> list[tuple[int, BoundarySource, float]]:
        """Return group, source and value of the quantities that detectors must see, by second.

        These are as a rule few: a detector without exceedance need not see others. `observations`
        are those of the groups.
        """
        of_intensity = variance_ratios(series, groups, self._settings.elevation_mask)
        of_rates = self._rates.update(series, groups)
        quantities = RayQuantities(
            *(np.concatenate(column) for column in zip(of_intensity, of_rates, strict=True))
        )
        sources = len(BoundarySource)
        thresholds = np.full(sources, np.inf)
        for source, threshold in self._thresholds.items():
            thresholds[source] = threshold
        columns = series.block.columns
        satellite = satellite_number(columns["system"][observations], columns["prn"][observations])
        key = sources * satellite[quantities.group] + quantities.source
        expecting = [
            sources * int(satellite_number(system, prn)) + source
            for (system, prn, source), detector in self._detectors.items()
            if detector.is_expecting
        ]
        exceeding = key[quantities.value > thresholds[quantities.source]]
        seen = np.flatnonzero(np.isin(key, [*expecting, *exceeding.tolist()]))
        seen = seen[np.argsort(groups.second[quantities.group[seen]], kind="stable")]
        group, number, value = (column[seen].tolist() for column in quantities)
        return list(zip(group, map(BoundarySource, number), value, strict=True))

    def _boundary(
        self,
        source: BoundarySource,
        system: int,
        prn: int,
        edge: Edge,
        position_itrf: FloatArray,
        direction_itrf: FloatArray,
    ) -> Boundary:
        return Boundary(
            kind=BoundaryKind.HORIZONTAL,
            source=source,
            spacecraft=self._spacecraft,
            system=system,
            prn=prn,
            time=round(edge.time * NANOSECONDS_PER_SECOND),
            time_sigma=edge.time_sigma,
            is_entry=edge.is_entry,
            position_itrf=edge_position(
                position_itrf, direction_itrf, self._settings.irregularity_altitude
            ),
            confidence=edge.confidence,
        )
