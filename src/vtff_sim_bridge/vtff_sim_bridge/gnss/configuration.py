"""GNSS files (``config/gnss/*.yaml``): constellation, atmosphere, receivers and faults of a run.

Read strictly, as scenario files are: an unknown key, a missing field, a wrong type or a value out
of range is a `ScenarioError` that names the file and the field.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from vtff_gnss.antenna_pattern import ParabolicPattern
from vtff_gnss.antex import PhaseCentre, antex_frequency, read_antex
from vtff_sim_bridge.atmosphere.density_models import (
    ChapmanLayer,
    Depletion,
    chapman_profile,
    depleted_profile,
)
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile, read_profile
from vtff_sim_bridge.atmosphere.horizontal_structure import (
    HorizontalGradient,
    TravellingDisturbance,
)
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.gnss.receiver_clock import ClockModel
from vtff_sim_bridge.gnss.signal_table import SIGNALS
from vtff_sim_bridge.noise.random_streams import Effect, generator
from vtff_sim_bridge.truth.scenario_fields import ScenarioError, Section, read_yaml

__all__ = [
    "BiasDriftModel",
    "ConstellationConfiguration",
    "GnssConfiguration",
    "MultipathModel",
    "NoiseModel",
    "ReceiverConfiguration",
    "SkyDraw",
    "TrackingModel",
    "assign_vehicles",
    "load_gnss_configuration",
]


@dataclass(frozen=True)
class ConstellationConfiguration:
    """Source of the satellites.

    Parameters
    ----------
    source : str
        ``nominal``, or a RINEX navigation file or a YUMA almanac (``.yuma``, ``.alm``, ``.txt``).
    seed : int
        Seed of the nominal constellations.
    orbit_error_sigma, clock_error_sigma : float
        True less broadcast orbit, for each satellite and axis, and clock, m: errors that the
        broadcast ephemerides do not tell.
    error_correlation_time : float
        Time constant of these errors, s; 0: they are constant.
    upload_error_sigma : float
        Steps of along-track position and clock, m, from one broadcast ephemeris of a satellite to
        its next: the message is off, the satellite flies on smoothly.
    inter_signal_sigma : float
        Satellite biases of each signal beyond the broadcast group delays, m.
    """

    source: str = "nominal"
    seed: int = 0
    orbit_error_sigma: float = 0.0
    clock_error_sigma: float = 0.0
    error_correlation_time: float = 0.0
    upload_error_sigma: float = 0.0
    inter_signal_sigma: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        _require_not_negative(
            self,
            "orbit_error_sigma",
            "clock_error_sigma",
            "error_correlation_time",
            "upload_error_sigma",
            "inter_signal_sigma",
        )


@dataclass(frozen=True)
class SkyDraw:
    """Quantities that a GNSS file leaves to the seed of the run.

    Parameters
    ----------
    constellation : bool
        The nominal constellations are those of the seed of the run.
    electron_density_sigma : float
        All densities are multiplied by exp(sigma times a standard normal number).
    """

    constellation: bool = False
    electron_density_sigma: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        _require_not_negative(self, "electron_density_sigma")

    def draw(self, configuration: GnssConfiguration) -> GnssConfiguration:
        """Return a configuration with the sky of its seed."""
        seed = configuration.seed
        constellation, profile = configuration.constellation, configuration.profile
        if self.constellation:
            constellation = dataclasses.replace(constellation, seed=seed)
        if profile is not None and self.electron_density_sigma > 0.0:
            number = generator(seed, Effect.ELECTRON_DENSITY).standard_normal()
            profile = profile.scaled(math.exp(self.electron_density_sigma * number))
        return dataclasses.replace(configuration, constellation=constellation, profile=profile)


@dataclass(frozen=True)
class NoiseModel:
    """Noise of the measurements.

    Parameters
    ----------
    model : str
        ``none``; ``fixed``: the sigmas below; ``cn0``: from C/N0 and the loops.
    code_sigma, phase_sigma, doppler_sigma : float
        m, m, m/s.
    code_loop_bandwidth_hz, phase_loop_bandwidth_hz : float
        Noise bandwidths of the delay lock loop (carrier-aided) and the phase lock loop, Hz.
    integration_time : float
        Predetection, s.
    correlator_spacing_chips : float
        Early to late.
    is_coloured : bool
        Whether code and phase noise are correlated as first-order loops of these bandwidths leave
        them, ``exp(-4 B |t|)``; else they are white.
    stated_sigma_factor : float
        What the receiver states over the true sigma of code, phase and Doppler.
    """

    model: str = "cn0"
    code_sigma: float = 0.3
    phase_sigma: float = 0.001
    doppler_sigma: float = 0.01
    code_loop_bandwidth_hz: float = 0.25
    phase_loop_bandwidth_hz: float = 15.0
    integration_time: float = 0.02
    correlator_spacing_chips: float = 0.1
    is_coloured: bool = False
    stated_sigma_factor: float = 1.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        if self.model not in ("none", "fixed", "cn0"):
            raise ValueError(f"model: one of none, fixed, cn0 expected, got {self.model!r}")
        _require_not_negative(self, "code_sigma", "phase_sigma", "doppler_sigma")
        for name in (
            "code_loop_bandwidth_hz",
            "phase_loop_bandwidth_hz",
            "integration_time",
            "stated_sigma_factor",
        ):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: more than 0 expected")
        if not 0.0 < self.correlator_spacing_chips < 2.0:
            raise ValueError("correlator_spacing_chips: between 0 and 2 expected")


@dataclass(frozen=True)
class TrackingModel:
    """When signals are tracked.

    Parameters
    ----------
    elevation_mask_deg : float
        Above the local horizontal plane; may be negative.
    channels : int
        Satellites of each system that are tracked at once.
    threshold_dbhz : float
        Lock is lost below this C/N0.
    acquisition_delay : float
        s between the rise of a satellite, or the return of a signal, and lock. Signals that are
        there at the start are locked at once.
    parity_delay : float
        s after lock until the half cycle of signals with data is known.
    ephemeris_delay : float
        s after lock until the ephemeris of a satellite is known.
    has_noise_slips : bool
        Whether the loops slip by noise and dynamics, see `noise.cycle_slips.slip_rate`; bandwidth
        and integration time are those of `NoiseModel`.
    cold_start_duration : float
        Whole s from the start of the run during which the receiver searches: it knows no time and
        tracks nothing, its headers say so, and BESTXYZ has too few observations. 0: hot start.
    """

    elevation_mask_deg: float = 5.0
    channels: int = 12
    threshold_dbhz: float = 25.0
    acquisition_delay: float = 2.0
    parity_delay: float = 1.0
    ephemeris_delay: float = 0.0
    has_noise_slips: bool = False
    cold_start_duration: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not -90.0 <= self.elevation_mask_deg < 90.0:
            raise ValueError("elevation_mask_deg: between -90 and 90 expected")
        if not 1 <= self.channels <= 31:
            raise ValueError("channels: between 1 and 31 expected")
        _require_not_negative(self, "acquisition_delay", "parity_delay", "ephemeris_delay")
        if not (self.cold_start_duration >= 0.0 and self.cold_start_duration % 1.0 == 0.0):
            raise ValueError("cold_start_duration: a whole number of s expected")


@dataclass(frozen=True)
class MultipathModel:
    """Slowly varying errors by reflections, each signal of each satellite and antenna for itself.

    They are the sum of a sinusoid with a seeded phase and of a Gauss-Markov process; each is off
    while its sizes are 0.

    Parameters
    ----------
    code_amplitude, phase_amplitude : float
        Amplitudes of the sinusoids at the horizon, m; they fall with the cosine of the elevation.
    period : float
        Period of the sinusoids, s; that of a signal is between 0.7 and 1.3 times it.
    code_sigma, phase_sigma : float
        Sigmas of the Gauss-Markov processes, m.
    correlation_time : float
        Time constant of the Gauss-Markov processes, s.
    elevation_model : str
        ``constant``: the sigmas hold at all elevations; ``cosine``: they are those at the horizon
        and fall with the cosine of the elevation.
    follows_cn0 : bool
        Whether the sigmas grow as the amplitude of the direct signal falls below that at boresight:
        they are multiplied by 10^((C/N0 at boresight - C/N0) / 20), between 1 and 10.
    """

    code_amplitude: float = 0.0
    phase_amplitude: float = 0.0
    period: float = 120.0
    code_sigma: float = 0.0
    phase_sigma: float = 0.0
    correlation_time: float = 100.0
    elevation_model: str = "constant"
    follows_cn0: bool = False

    def __post_init__(self) -> None:
        """Check the parameters."""
        _require_not_negative(
            self, "code_amplitude", "phase_amplitude", "code_sigma", "phase_sigma"
        )
        for name in ("period", "correlation_time"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: more than 0 s expected")
        if self.elevation_model not in ("constant", "cosine"):
            raise ValueError(
                f"elevation_model: one of constant, cosine expected, got {self.elevation_model!r}"
            )


@dataclass(frozen=True)
class BiasDriftModel:
    """Drift of the line biases of a receiver, by temperature: Gauss-Markov, one for each signal.

    Parameters
    ----------
    code_sigma, phase_sigma : float
        m.
    correlation_time : float
        s.
    """

    code_sigma: float = 0.0
    phase_sigma: float = 0.0
    correlation_time: float = 1500.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        _require_not_negative(self, "code_sigma", "phase_sigma")
        if not self.correlation_time > 0.0:
            raise ValueError("correlation_time: more than 0 s expected")


@dataclass(frozen=True)
class ReceiverConfiguration:
    """One receiver.

    Parameters
    ----------
    name : str
        Also the name of its port link.
    vehicle : str
        Vehicle of the scenario, e.g. ``v1_m1``.
    cn0_zenith_dbhz : dict of str to float
        Signals that it tracks, and their C/N0 at boresight from 20200 km.
    baud : int
        Rate of the port until SERIALCONFIG.
    limits_baud : bool
        The port carries no more than its rate allows (for real time).
    tcp_port : int or None
        Also serve the port on TCP; 0 for any free one.
    biases : dict of str to float
        Receiver bias of the pseudoranges of each signal, m.
    lever_arm_body : tuple of 3 float or None
        From the centre of mass to the reference point of the antenna in body axes, m.
    phase_centre : PhaseCentre or None
        Offsets and variations from that point. The up axis of the antenna is the negative z axis of
        the body, its north axis is the x axis.
    has_wind_up : bool
        Whether the phase counts the turns of the antenna, see `receiver.wind_up`.
    """

    name: str
    vehicle: str
    cn0_zenith_dbhz: Mapping[str, float]
    generation: Literal["OEM6", "OEM7"] = "OEM6"
    baud: int = 460800
    limits_baud: bool = False
    tcp_port: int | None = None
    biases: Mapping[str, float] = field(default_factory=dict)
    clock: ClockModel = field(default_factory=ClockModel)
    noise: NoiseModel = field(default_factory=NoiseModel)
    tracking: TrackingModel = field(default_factory=TrackingModel)
    multipath: MultipathModel = field(default_factory=MultipathModel)
    bias_drift: BiasDriftModel = field(default_factory=BiasDriftModel)
    antenna: ParabolicPattern | None = None
    lever_arm_body: tuple[float, ...] | None = None
    phase_centre: PhaseCentre | None = None
    has_wind_up: bool = False

    @property
    def has_antenna_geometry(self) -> bool:
        """Whether the axes of the body matter to ranges or phases."""
        is_away = self.lever_arm_body is not None or self.phase_centre is not None
        return is_away or self.has_wind_up


@dataclass(frozen=True, eq=False)
class GnssConfiguration:
    """Contents of a GNSS file; see `load_gnss_configuration`."""

    name: str
    seed: int
    constellation: ConstellationConfiguration
    profile: ElectronDensityProfile | None
    regions: tuple[IrregularityRegion, ...]
    receivers: tuple[ReceiverConfiguration, ...]
    faults: tuple[Fault, ...]
    structures: tuple[HorizontalGradient | TravellingDisturbance, ...] = ()


def load_gnss_configuration(path: str | Path, seed: int | None = None) -> GnssConfiguration:
    """Read a GNSS file.

    The file has the fields ``name``, ``seed``, ``constellation`` (`ConstellationConfiguration`),
    ``atmosphere`` (``electron_density``: null, or one of ``chapman``, a list of layers, and
    ``table``, a CSV file, with ``scale`` and ``depletions``, a list of `Depletion`; ``gradients``
    and ``travelling_disturbances``: lists of `HorizontalGradient` and `TravellingDisturbance`;
    ``regions``: a list of `IrregularityRegion` with angles in deg),
    ``receivers`` and ``faults`` (lists of `ReceiverConfiguration` and `Fault`). Fields of
    ``receiver_defaults`` hold for each receiver that does not give them. Paths are relative to the
    file. Fields with a default in their class may be left out. ``extends`` names a file in the same
    folder, whose fields hold where this one has none. ``draw`` (`SkyDraw`) leaves
    constellation and ionosphere to the seed.

    Parameters
    ----------
    path : path-like
    seed : int, optional
        Replaces the seed of the file.

    Raises
    ------
    ScenarioError
        If the file cannot be used.
    """
    path = Path(path)
    top = Section(str(path), "", _read_extended(path))
    defaults = top.value("receiver_defaults") if "receiver_defaults" in top else {}
    if not isinstance(defaults, dict):
        raise top.error("receiver_defaults", "a mapping of fields expected")
    constellation = ConstellationConfiguration()
    if "constellation" in top:
        constellation = top.section("constellation").make_dataclass(ConstellationConfiguration)
    if constellation.source != "nominal":
        source = str(path.parent / constellation.source)
        constellation = dataclasses.replace(constellation, source=source)
    profile = None
    regions: tuple[IrregularityRegion, ...] = ()
    structures: tuple[HorizontalGradient | TravellingDisturbance, ...] = ()
    if "atmosphere" in top:
        atmosphere = top.section("atmosphere")
        structures = _horizontal_structures(atmosphere)
        profile, regions = _atmosphere(atmosphere, path)
    entries = top.value("receivers")
    if not isinstance(entries, list) or not entries:
        raise top.error("receivers", "a list of at least one mapping expected")
    receivers = tuple(
        _receiver(
            Section(str(path), f"receivers[{index}]", _merge(top, index, defaults, entry)), path
        )
        for index, entry in enumerate(entries)
    )
    names = [receiver.name for receiver in receivers]
    if len(set(names)) < len(names):
        raise top.error("receivers", f"names are given twice: {', '.join(names)}")
    faults: tuple[Fault, ...] = ()
    if top.value("faults") if "faults" in top else None:
        faults = tuple(section.make_dataclass(Fault) for section in top.sections("faults"))
    for index, fault in enumerate(faults):
        if fault.receiver not in names:
            raise top.error(f"faults[{index}].receiver", f"there is no {fault.receiver!r}")
    seed_of_file = top.whole_number("seed")
    draw = top.section("draw").make_dataclass(SkyDraw) if "draw" in top else SkyDraw()
    configuration = GnssConfiguration(
        name=top.text("name"),
        seed=seed_of_file if seed is None else seed,
        constellation=constellation,
        profile=profile,
        regions=regions,
        receivers=receivers,
        faults=faults,
        structures=structures,
    )
    top.finish()
    return draw.draw(configuration)


def _read_extended(path: Path) -> Any:
    """Return the fields of a file with those of the file that it extends."""
    fields = read_yaml(path)
    if not isinstance(fields, dict) or "extends" not in fields:
        return fields
    name = fields["extends"]
    if not isinstance(name, str) or Path(name).name != name or name == path.name:
        raise ScenarioError(f"{path}: extends: another file of the same folder expected")
    base = read_yaml(path.parent / name)
    if not isinstance(base, dict) or "extends" in base:
        raise ScenarioError(f"{path}: extends: {name} has no fields, or extends a file itself")
    return {**base, **{key: value for key, value in fields.items() if key != "extends"}}


def assign_vehicles(
    configuration: GnssConfiguration, vehicles: Mapping[str, str]
) -> GnssConfiguration:
    """Return a configuration whose receivers are on the vehicles of their spacecraft.

    Parameters
    ----------
    configuration : GnssConfiguration
        A receiver has the name of its spacecraft.
    vehicles : mapping of str to str
        SimGEN's vehicle of each spacecraft.

    Raises
    ------
    ScenarioError
        If there is no spacecraft of the name of a receiver, or the receiver is told to be on the
        vehicle of another one.
    """
    receivers = []
    for receiver in configuration.receivers:
        vehicle = vehicles.get(receiver.name)
        if vehicle is None:
            raise ScenarioError(
                f"receiver {receiver.name}: there is no spacecraft of that name; the scenario has "
                f"{', '.join(vehicles)}"
            )
        if receiver.vehicle not in ("", vehicle):
            raise ScenarioError(
                f"receiver {receiver.name}: vehicle is {receiver.vehicle}, but the spacecraft of "
                f"that name is {vehicle}"
            )
        receivers.append(dataclasses.replace(receiver, vehicle=vehicle))
    return dataclasses.replace(configuration, receivers=tuple(receivers))


def _merge(top: Section, index: int, defaults: dict[Any, Any], entry: Any) -> dict[Any, Any]:
    if not isinstance(entry, dict):
        raise top.error(f"receivers[{index}]", "a mapping of fields expected")
    return {**defaults, **entry}


def _receiver(section: Section, path: Path) -> ReceiverConfiguration:
    groups: dict[str, Any] = {}
    for name, kind in (
        ("clock", ClockModel),
        ("noise", NoiseModel),
        ("tracking", TrackingModel),
        ("multipath", MultipathModel),
        ("bias_drift", BiasDriftModel),
    ):
        if name in section:
            groups[name] = section.section(name).make_dataclass(kind)
    if "antenna" in section and section.value("antenna") is not None:
        groups["antenna"] = _antenna(section.section("antenna"))
    if "lever_arm" in section and section.value("lever_arm") is not None:
        groups["lever_arm_body"] = _lever_arm_body(section.section("lever_arm"))
    if "phase_centre" in section and section.value("phase_centre") is not None:
        signals = _numbers_by_signal(section.section("cn0_zenith_dbhz"))
        groups["phase_centre"] = _phase_centre(section.section("phase_centre"), path, signals)
    if "biases" in section:
        groups["biases"] = _numbers_by_signal(section.section("biases"))
    for name, hint in (
        ("baud", int),
        ("limits_baud", bool),
        ("tcp_port", int | None),
        ("has_wind_up", bool),
    ):
        if name in section:
            groups[name] = section.value_of_type(name, hint)
    generation = "OEM6"
    if "generation" in section:
        generation = section.choice("generation", ("OEM6", "OEM7"))
    name = section.text("name")
    if "/" in name or name.startswith("."):
        raise section.error("name", f"must be usable as a file name, got {name!r}")
    receiver = ReceiverConfiguration(
        name=name,
        vehicle=section.text("vehicle").lower() if "vehicle" in section else "",
        cn0_zenith_dbhz=_numbers_by_signal(section.section("cn0_zenith_dbhz")),
        generation=typing.cast(Literal["OEM6", "OEM7"], generation),
        **groups,
    )
    if not receiver.cn0_zenith_dbhz:
        raise section.error("cn0_zenith_dbhz", "at least one signal expected")
    section.finish()
    return receiver


def _lever_arm_body(section: Section) -> tuple[float, ...]:
    """Return a lever arm; its frame must be told, because a wrong one is not seen in the data."""
    section.choice("frame", ("body",))
    position = section.vector("position")
    section.finish()
    return tuple(position.tolist())


def _phase_centre(section: Section, path: Path, signals: Iterable[str]) -> PhaseCentre:
    file = path.parent / section.text("antex")
    antenna = section.text("antenna")
    try:
        phase_centre = section.convert("antenna", lambda: read_antex(file, antenna))
    except OSError as error:
        raise section.error("antex", f"{file}: {error.strerror or error}") from None
    for name in signals:
        signal = SIGNALS[name]
        if antex_frequency(signal.system, signal.band) not in phase_centre.maps:
            raise section.error("antenna", f"{file}: {antenna!r} has no frequency of {name}")
    section.finish()
    return phase_centre


def _antenna(section: Section) -> ParabolicPattern:
    pattern = section.convert(
        "",
        lambda: ParabolicPattern(
            0.0,
            math.radians(section.number("half_power_beamwidth_deg")),
            section.number("front_to_back_db"),
        ),
    )
    section.finish()
    return pattern


def _numbers_by_signal(section: Section) -> dict[str, float]:
    numbers = {name: section.number(name) for name in SIGNALS if name in section}
    section.finish()
    return numbers


def _atmosphere(
    section: Section, path: Path
) -> tuple[ElectronDensityProfile | None, tuple[IrregularityRegion, ...]]:
    profile = None
    if "electron_density" in section and section.value("electron_density") is not None:
        profile = _profile(section.section("electron_density"), path)
    regions: tuple[IrregularityRegion, ...] = ()
    if section.value("regions") if "regions" in section else None:
        regions = tuple(_region(part) for part in section.sections("regions"))
    section.finish()
    return profile, regions


def _horizontal_structures(
    section: Section,
) -> tuple[HorizontalGradient | TravellingDisturbance, ...]:
    structures: list[HorizontalGradient | TravellingDisturbance] = []
    if section.value("gradients") if "gradients" in section else None:
        structures += [
            entry.make_dataclass(HorizontalGradient) for entry in section.sections("gradients")
        ]
    name = "travelling_disturbances"
    if section.value(name) if name in section else None:
        structures += [
            entry.make_dataclass(TravellingDisturbance) for entry in section.sections(name)
        ]
    return tuple(structures)


def _profile(section: Section, path: Path) -> ElectronDensityProfile:
    kind = section.only_one_of("chapman", "table")
    if kind == "table":
        table = path.parent / section.text("table")
        column = section.text("column") if "column" in section else "density_per_m3"
        try:
            profile = section.convert("table", lambda: read_profile(table, column))
        except OSError as error:
            raise section.error("table", f"{table}: {error.strerror or error}") from None
    else:
        layers = [layer.make_dataclass(ChapmanLayer) for layer in section.sections("chapman")]
        profile = section.convert("chapman", lambda: chapman_profile(layers))
    if "scale" in section:
        profile = profile.scaled(section.number("scale", 0.0))
    if section.value("depletions") if "depletions" in section else None:
        depletions = [
            depletion.make_dataclass(Depletion) for depletion in section.sections("depletions")
        ]
        profile = depleted_profile(profile, depletions)
    section.finish()
    return profile


def _region(section: Section) -> IrregularityRegion:
    latitudes = (section.number("latitude_south_deg"), section.number("latitude_north_deg"))
    names = ("local_time_start_hours", "local_time_end_hours", "altitude_bottom", "altitude_top")
    numbers = {name: section.number(name) for name in (*names, "s4", "decorrelation_time")}
    for name in ("taper_length", "correlation", "drift_east"):
        if name in section:
            numbers[name] = section.number(name)
    region = section.convert(
        "",
        lambda: IrregularityRegion(
            name=section.text("name"),
            latitude_south=math.radians(latitudes[0]),
            latitude_north=math.radians(latitudes[1]),
            **numbers,
        ),
    )
    section.finish()
    return region


def _require_not_negative(group: object, *names: str) -> None:
    for name in names:
        if not getattr(group, name) >= 0.0:
            raise ValueError(f"{name}: 0 or more expected, got {getattr(group, name)}")
