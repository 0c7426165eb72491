"""Drawn observations of a formation: two spacecraft above the equator in a known ionosphere.

The satellites are those of the nominal GPS constellation, the contents are integrals along their
rays, and the noise of codes and phases is drawn. Receivers are not emulated; their clocks wander
by metres.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from formation_simulation import RADIUS, chapman

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.signals import SignalKey
from vtff_iono.geometry.mapping import profile_content
from vtff_iono.geometry.satellite_geometry import satellite_geometry
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

START = GpsTime.from_week_tow(2295, 7200.0)
"""Beginning of a set of ephemerides, and of a minute and an hour."""
SIGNALS = ((1, ord("C"), c.FREQUENCY_L1), (2, ord("W"), c.FREQUENCY_L2))
ALL_VALID = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN
LATITUDE_RATE = 7.4e3 / RADIUS
MASK = np.radians(6.0)


@dataclasses.dataclass
class DrawnFormation:
    """Parameters of a drawn formation; `seconds` draws it.

    `altitude` gives the altitude of the chief at times since `START`, s; the deputy is `offset`
    higher and `lag` seconds behind. `profile` is altitude and density. `receiver_bias` are the
    differential code biases of both receivers, s. `slips` maps (spacecraft, prn) to the time from
    which on the phases of both bands have other integers. `fades` maps prn to begin, end and S4 of
    fades of C/N0, without fluctuations of the phase. `extra_content` maps prn to a function of the
    time at which the chief is at the same place, s, that gives an additional content, TECU.
    From `fixed_again`, s, relative navigation has all integers, relative to another satellite.
    `relative_sigma` is what it states of the relative position, m.
    """

    altitude: Callable[[np.ndarray], np.ndarray]
    profile: tuple[np.ndarray, np.ndarray]
    offset: float = -985.0
    lag: float = 2.0
    receiver_bias: tuple[float, float] = (2.0e-9, -3.0e-9)
    code_sigma: float = 0.3
    phase_sigma: float = 0.001
    slips: dict[tuple[int, int], float] = dataclasses.field(default_factory=dict)
    fades: dict[int, tuple[float, float, float]] = dataclasses.field(default_factory=dict)
    extra_content: dict[int, Callable[[np.ndarray], np.ndarray]] = dataclasses.field(
        default_factory=dict
    )
    without_integers: tuple[int, ...] = ()
    fixed_again: float = np.inf
    relative_sigma: float = np.inf
    seed: int = 0

    def altitudes(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the altitudes of chief and deputy, m."""
        chief = self.altitude(np.asarray(time, dtype=float))
        return chief, chief + self.offset

    def position(self, craft: int, time: np.ndarray) -> np.ndarray:
        """Return positions (n, 3), ITRF, m."""
        time = np.asarray(time, dtype=float)
        longitude = LATITUDE_RATE * (time - self.lag * craft)
        altitude = self.altitudes(time)[craft]
        return itrf_from_geodetic(np.stack((np.zeros_like(time), longitude, altitude), axis=-1))

    def state(self, craft: int, time: float) -> np.ndarray:
        """Return position and Earth-fixed velocity, shape (6,)."""
        before, at, after = self.position(craft, np.array([time - 0.5, time, time + 0.5]))
        return np.concatenate((at, after - before))

    def ephemerides(self, duration: float) -> tuple[BroadcastEphemeris, ...]:
        """Return the ephemerides of a flight that begins at `START`."""
        return nominal_gps_constellation(START, START + duration, self.seed)

    def seconds(
        self, duration: float, interval: float, every: float = 1.0
    ) -> Iterator[FormationSecond]:
        """Yield seconds `every` so many s; each holds the epochs of one s, `interval` s apart."""
        generator = np.random.default_rng(self.seed)
        integers = generator.integers(-(10**6), 10**6, (2, 2, 64)).astype(float)
        slipped = integers + generator.integers(3, 50, (2, 2, 64))
        ephemerides = self.ephemerides(duration)
        store = EphemerisStore(ephemerides)
        group_delay = np.zeros(64)
        for ephemeris in ephemerides:
            group_delay[ephemeris.prn] = ephemeris.group_delay
        prns = np.array(sorted({e.prn for e in ephemerides}), dtype=np.uint8)
        ends = np.arange(every, duration + 1e-6, every)
        steps = np.arange(round(1.0 / interval))[::-1] * interval
        fading = {prn: generator.standard_normal(200_000) for prn in self.fades}
        for first in range(0, len(ends), 300):
            block_ends = ends[first : first + 300]
            time = (block_ends[:, np.newaxis] - steps).ravel()
            blocks = [
                self._observations(
                    craft, time, prns, store, generator, integers, slipped, group_delay, fading
                )
                for craft in (0, 1)
            ]
            for end in block_ends:
                yield FormationSecond(
                    (START + float(end)).nanoseconds,
                    tuple(_part(block, end) for block in blocks),
                    (self.state(0, end), self.state(1, end)),
                    (self._integers(float(end), prns, integers, slipped),),
                    (self.relative_sigma,),
                )

    def _is_slipped(self, craft: int, prn: np.ndarray, time: np.ndarray | float) -> np.ndarray:
        since = np.array([self.slips.get((craft, int(p)), np.inf) for p in range(64)])
        return time >= since[prn]

    def _integers(self, end, prns, integers, slipped):  # type: ignore[no-untyped-def]
        """Return the integers that relative navigation has: those after a slip once it fixes again.

        It has another reference satellite then.
        """
        table = {}
        fixes_again = end >= self.fixed_again
        for index, (band, attribute, _) in enumerate(SIGNALS):
            of_crafts = [
                np.where(self._is_slipped(craft, np.arange(64), end), slipped[craft, index], before)
                for craft, before in enumerate(integers[:, index])
            ]
            single = of_crafts[1] - of_crafts[0]
            reference = single[prns[3 if fixes_again else 0]]
            for prn in prns.tolist():
                has_slipped = any(end >= self.slips.get((craft, prn), np.inf) for craft in (0, 1))
                if (fixes_again or not has_slipped) and prn not in self.without_integers:
                    key = SignalKey(c.SYSTEM_GPS, prn, band, attribute)
                    table[key] = single[prn] - reference
        return table

    def _observations(  # type: ignore[no-untyped-def]
        self, craft, time, prns, store, generator, integers, slipped, group_delay, fading
    ):
        epoch = np.repeat(np.arange(len(time)), len(prns))
        prn = np.tile(prns, len(time))
        nanoseconds = START.nanoseconds + np.round(time * 1e9).astype(np.int64)
        position = self.position(craft, time)
        geometry = satellite_geometry(
            store, nanoseconds[epoch], np.zeros_like(prn), prn, position[epoch]
        )
        up = np.flatnonzero(geometry.elevation > MASK)
        epoch, prn, elevation = epoch[up], prn[up], geometry.elevation[up]
        clock = 3.0 * np.sin(time / (7.0 + craft) + craft)
        distance = geometry.range[up] + clock[epoch]
        radius = np.linalg.norm(position, axis=-1)[epoch]
        content = profile_content(elevation, radius, *self.profile)
        seconds = time[epoch]
        for satellite, extra in self.extra_content.items():
            content += np.where(prn == satellite, extra(seconds - self.lag * craft), 0.0)
        # Thermal noise of C/N0 over 50 ms.
        cn0 = np.full(len(prn), 45.0) + 0.11 * generator.standard_normal(len(prn))
        for satellite, (begin, end, size) in self.fades.items():
            place = np.round((seconds - self.lag * craft) * 20.0).astype(int) % 200_000
            fade = np.convolve(fading[satellite], np.ones(5) / np.sqrt(5.0), mode="same")[place]
            active = (prn == satellite) & (seconds >= begin) & (seconds < end)
            cn0 += np.where(active, 4.34 * size * fade, 0.0)
        shape = (len(prn), 2)
        code, cycles = np.empty(shape), np.empty(shape)
        has_slipped = self._is_slipped(craft, prn, seconds)
        for index, (_, _, frequency) in enumerate(SIGNALS):
            delay = 40.308193e16 / frequency**2 * content
            ambiguity = np.where(
                has_slipped, slipped[craft, index, prn], integers[craft, index, prn]
            )
            code[:, index] = (
                distance + delay + self.code_sigma * generator.standard_normal(shape[0])
            )
            phase = distance - delay + self.phase_sigma * generator.standard_normal(shape[0])
            cycles[:, index] = phase * frequency / SPEED_OF_LIGHT + ambiguity
        ratio = 1.0 - (c.FREQUENCY_L1 / c.FREQUENCY_L2) ** 2
        code[:, 0] += SPEED_OF_LIGHT * (group_delay[prn] * ratio + self.receiver_bias[craft])
        lock = 1000.0 + seconds - np.where(has_slipped, 990.0, 0.0)
        columns = {
            "system": np.zeros(2 * len(prn), dtype=np.uint8),
            "prn": np.repeat(prn, 2).astype(np.uint8),
            "band": np.tile([s[0] for s in SIGNALS], len(prn)).astype(np.uint8),
            "attribute": np.tile([s[1] for s in SIGNALS], len(prn)).astype(np.uint8),
            "glonass_channel": np.zeros(2 * len(prn), dtype=np.int8),
            "pseudorange": code.ravel(),
            "carrier_phase_cycles": cycles.ravel(),
            "cn0_dbhz": np.repeat(cn0, 2).astype(np.float32),
            "lock_time": np.repeat(lock, 2).astype(np.float32),
            "flags": np.full(2 * len(prn), ALL_VALID, dtype=np.uint16),
        }
        return np.repeat(nanoseconds[epoch], 2), columns


def _part(block, end):  # type: ignore[no-untyped-def]
    """Return the second of a block that ends at a time since `START`."""
    time, columns = block
    last = START.nanoseconds + round(end * 1e9)
    first, stop = np.searchsorted(time, (last - NANOSECONDS_PER_SECOND + 1, last + 1))
    return ObservationBlock(
        time[first:stop], {name: column[first:stop] for name, column in columns.items()}
    )


def layer() -> tuple[np.ndarray, np.ndarray]:
    """Return altitude and density of a quiet layer."""
    altitude = np.arange(100e3, 2000e3, 2e3)
    return altitude, chapman(altitude)
