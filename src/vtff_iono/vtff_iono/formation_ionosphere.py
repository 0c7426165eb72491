"""The ionosphere that two spacecraft see together, second by second, online or from a recording.

Each second brings the observations of both receivers since the last one, their positions, and the
integers that relative navigation has fixed. From it come the contents and the scintillation of each
spacecraft (`vtff_iono.spacecraft.spacecraft_ionosphere`), and the electron density between the two.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_iono.bias.code_biases import CodeBiasTable
from vtff_iono.density.electron_density import DensitySettings
from vtff_iono.density.formation_density import DensityResult, FormationDensity
from vtff_iono.edges.formation_boundaries import (
    Boundary,
    BoundarySettings,
    DensitySample,
    FormationBoundaries,
)
from vtff_iono.spacecraft.formation_second import FormationSecond, Track
from vtff_iono.spacecraft.spacecraft_ionosphere import (
    PreparedBlock,
    SpacecraftIonosphere,
    SpacecraftResult,
    SpacecraftSettings,
)

__all__ = ["FormationIonosphere", "FormationResult", "FormationSettings"]

# Of a recording; bounds the memory.
_SECONDS_AT_ONCE = 100


@dataclass(frozen=True)
class FormationSettings:
    """How a formation is processed.

    Parameters
    ----------
    spacecraft : SpacecraftSettings
        Of both.
    density : DensitySettings
    boundaries : BoundarySettings
    density_bands : tuple of int
        RINEX frequency digits of the GPS signals that the density is made of.
    carrier_phase_sigma : float
        Noise of one carrier phase of one receiver at the full rate, m.
    """

    spacecraft: SpacecraftSettings = SpacecraftSettings()
    density: DensitySettings = DensitySettings()
    boundaries: BoundarySettings = BoundarySettings()
    density_bands: tuple[int, int] = (1, 2)
    carrier_phase_sigma: float = 0.001


@dataclass(frozen=True, eq=False)
class FormationResult:
    """What a second has told.

    Parameters
    ----------
    spacecraft : tuple of SpacecraftResult
        Chief and deputy.
    density : tuple of DensityResult
        Of the seconds that have ended: one, as a rule, whose samples reach up to one before `time`.
    boundaries : tuple of Boundary
        Edges that have been confirmed.
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
        Satellite biases; those of the ephemerides by default.

    Attributes
    ----------
    spacecraft : tuple of SpacecraftIonosphere
        Chief and deputy.
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
        self._boundaries = FormationBoundaries(settings.boundaries)

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take a broadcast ephemeris that either receiver has decoded."""
        for spacecraft in self.spacecraft:
            spacecraft.add_ephemeris(ephemeris)

    def process(self, second: FormationSecond) -> FormationResult:
        """Take the next second in."""
        return next(self._process_all([second]))

    def process_recording(
        self, recording: Iterable[tuple[Sequence[BroadcastEphemeris], FormationSecond]]
    ) -> Iterator[FormationResult]:
        """Take seconds in and yield what each has told.

        The results have the same bytes as those of `add_ephemeris` and `process` for each second,
        in half the time: what can be done for many seconds at once is.

        Parameters
        ----------
        recording : iterable
            New ephemerides and the second, in order of time.
        """
        waiting: list[FormationSecond] = []
        for ephemerides, second in recording:
            if ephemerides or len(waiting) == _SECONDS_AT_ONCE:
                yield from self._process_all(waiting)
                waiting = []
            for ephemeris in ephemerides:
                self.add_ephemeris(ephemeris)
            waiting.append(second)
        yield from self._process_all(waiting)

    def _process_all(self, seconds: Sequence[FormationSecond]) -> Iterator[FormationResult]:
        if not seconds:
            return
        tracks, prepared = [], []
        for craft, spacecraft in enumerate(self.spacecraft):
            track, own = self._tracks[craft], []
            for second in seconds:
                track = track.followed_by(second.time, second.states_itrf[craft])
                own.append(track)
            blocks = [second.observations[craft] for second in seconds]
            positions = [
                track.positions(block.time) for track, block in zip(own, blocks, strict=True)
            ]
            tracks.append(own)
            prepared.append(spacecraft.prepare(blocks, positions))
        for place, second in enumerate(seconds):
            self._tracks = (tracks[0][place], tracks[1][place])
            yield self._processed(second, (prepared[0][place], prepared[1][place]))

    def _processed(
        self, second: FormationSecond, prepared: tuple[PreparedBlock, PreparedBlock]
    ) -> FormationResult:
        chief, deputy = (
            spacecraft.process_prepared(part)
            for spacecraft, part in zip(self.spacecraft, prepared, strict=True)
        )
        links = (self.spacecraft[0].links, self.spacecraft[1].links)
        density = tuple(self._density.update(second, (chief, deputy), links, self._tracks))
        samples = [
            DensitySample(
                one.time,
                one.epoch.altitude,
                one.epoch.separation,
                one.epoch.density,
                one.epoch.sigma,
            )
            for one in density
        ]
        boundaries = self._boundaries.update(
            second.observations,
            (prepared[0].position_itrf, prepared[1].position_itrf),
            (chief, deputy),
            links,
            samples,
        )
        return FormationResult((chief, deputy), density, tuple(boundaries))
