"""Scenario files (``config/scenario/*.yaml``): what flies, from where, under which forces.

A scenario file is read strictly: an unknown key, a missing field, a wrong type or a value out of
range is a `ScenarioError` that names the file and the field. The form of the file is described in
`load_scenario`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.spacecraft import SpacecraftBody
from vtff_dynamics.constants import GM_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.earth import right_ascension_from_longitude
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements, true_anomaly_from_mean
from vtff_dynamics.orbit.propagator import ForceModel
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.attitude.adcs_module import AdcsModuleModel
from vtff_sim_bridge.attitude.attitude_setting import (
    AttitudeEnvironment,
    AttitudeFault,
    AttitudeSetting,
    AttitudeStart,
    AttitudeThruster,
    BodyThrusters,
)
from vtff_sim_bridge.attitude.attitude_truth import AttitudeTruth
from vtff_sim_bridge.attitude.magnetometer import MagnetometerModel
from vtff_sim_bridge.truth.drawn_geometry import GeometryDraw
from vtff_sim_bridge.truth.formation_truth import FormationTruth
from vtff_sim_bridge.truth.repeated_spacecraft import repeat_spacecraft
from vtff_sim_bridge.truth.scenario_fields import (
    DEFAULT_HARD_RADIUS,
    ScenarioError,
    Section,
    read_yaml,
)
from vtff_sim_bridge.truth.thruster_errors import ThrusterErrorModel, ThrusterErrors

__all__ = [
    "INTEGRATORS",
    "SHARED_NAMESPACES",
    "Scenario",
    "ScenarioError",
    "Spacecraft",
    "load_scenario",
    "read_scenario",
    "state_ahead_on_orbit",
]

_PARTS_OF_ATTITUDE: dict[str, type] = {
    "body": SpacecraftBody,
    "magnetometer": MagnetometerModel,
    "module": AdcsModuleModel,
    "start": AttitudeStart,
    "environment": AttitudeEnvironment,
    "thruster": AttitudeThruster,
    "propulsion": BodyThrusters,
}

INTEGRATORS = ("rk4", "euler")
"""Names accepted by the field ``integrator``."""

SHARED_NAMESPACES = frozenset(("formation", "iono", "sim"))
"""Namespaces of topics that belong to no single spacecraft; none may have such a name."""


@dataclass(frozen=True, eq=False)
class Spacecraft:
    """One spacecraft of a scenario.

    Attributes
    ----------
    name
        Name; also the ROS namespace of its nodes.
    role
        ``chief`` or ``deputy``.
    state_gcrf
        Position (m) and velocity (m/s) at the epoch in GCRF, shape (6,).
    target_rtn
        Wanted position (m) and rotating-frame velocity (m/s) relative to the chief in RTN,
        shape (6,); None where the file gives no target.
    force_model
        Forces on it where they differ from those of the scenario, else None.
    thruster_errors
        Errors of its thruster; None for a thruster that gives what it reports.
    attitude
        Its attitude and ADCS module; None for a spacecraft that does not turn.
    """

    name: str
    role: str
    state_gcrf: FloatArray
    target_rtn: FloatArray | None = None
    force_model: ForceModel | None = None
    thruster_errors: ThrusterErrorModel | None = None
    attitude: AttitudeSetting | None = None


@dataclass(frozen=True, eq=False)
class Scenario:
    """Contents of a scenario file; see `load_scenario`.

    Raises
    ------
    ValueError
        If the duration is not one or more whole steps, also when `dataclasses.replace` sets it.
    """

    name: str
    description: str
    epoch: GpsTime
    duration: float
    seed: int
    force_model: ForceModel
    integrator: str
    step: float
    spacecraft: tuple[Spacecraft, ...]
    hard_radius: float = DEFAULT_HARD_RADIUS

    def __post_init__(self) -> None:
        """Check the duration against the step."""
        steps = self.duration / self.step
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-9 * steps:
            raise ValueError(
                f"duration: one or more whole steps of {self.step:g} s expected, "
                f"got {self.duration:g} s"
            )

    @property
    def chief(self) -> Spacecraft:
        """The chief, always the first spacecraft."""
        return self.spacecraft[0]

    @property
    def deputies(self) -> tuple[Spacecraft, ...]:
        """All spacecraft but the chief."""
        return self.spacecraft[1:]

    def formation_truth(self) -> FormationTruth:
        """Return the true motion of the formation, standing at the epoch."""
        return FormationTruth(
            self.epoch,
            [(spacecraft.name, spacecraft.state_gcrf) for spacecraft in self.spacecraft],
            self.force_model,
            integrator=self.integrator,
            step=self.step,
            force_models={
                spacecraft.name: spacecraft.force_model
                for spacecraft in self.spacecraft
                if spacecraft.force_model is not None
            },
            thruster_errors={
                spacecraft.name: ThrusterErrors(
                    spacecraft.thruster_errors, self.seed, spacecraft.name
                )
                for spacecraft in self.spacecraft
                if spacecraft.thruster_errors is not None
            },
        )

    def attitude_truths(self) -> dict[str, AttitudeTruth]:
        """Return the true attitude of every spacecraft that has one, standing at the epoch.

        Raises
        ------
        ValueError
            If an attitude does not fit epoch or step; the message names spacecraft and field.
        """
        truths = {}
        for index, craft in enumerate(self.spacecraft):
            if craft.attitude is None:
                continue
            try:
                truths[craft.name] = AttitudeTruth(
                    craft.attitude, craft.name, self.seed, self.epoch, craft.state_gcrf, self.step
                )
            except ValueError as error:
                raise ValueError(f"spacecraft[{index}].attitude: {error}") from None
        return truths


def load_scenario(
    path: str | Path, seed: int | None = None, number_of_deputies: int = 0
) -> Scenario:
    """Read a scenario file.

    Fields (SI units; angles in degrees where the name says so)::

        name, description      texts
        epoch                  "2016-03-21T01:00:00 GPS" (or UTC)
        duration, step         s; the duration is a whole number of steps
        seed                   whole number of 0 or more
        integrator             rk4 | euler
        hard_radius            m (optional, 10): no two spacecraft may come closer
        draw                   (optional) fields of truth.drawn_geometry.GeometryDraw: epoch and
                               orbits that the seed draws
        force_model            fields of vtff_dynamics.orbit.propagator.ForceModel
        spacecraft             a list, the chief first:
          - name               lower-case letters, digits, underscores; none of SHARED_NAMESPACES
            repeat             (optional) this entry stands for so many deputies, see
                               truth.repeated_spacecraft
            role               chief | deputy
            orbit              one of
              cartesian_gcrf:  {position: [3], velocity: [3]}
              elements:        {semi_major_axis, eccentricity, inclination_deg,
                                argument_of_perigee_deg,
                                right_ascension_deg | longitude_of_ascending_node_deg,
                                true_anomaly_deg | mean_anomaly_deg}
              same_orbit_ahead: m (deputies only), see `state_ahead_on_orbit`
              relative_rtn:    {position: [3], velocity: [3] (optional, zero)} (deputies only),
                               relative to the chief in its rotating RTN frame
            target             (deputies only, optional)
              position_relative_rtn: [3]
              velocity_relative_rtn: [3] (optional, zero)
            force_model        (optional) fields of the force model that are different for it
            thruster_errors    (optional) fields of truth.thruster_errors.ThrusterErrorModel
            attitude           (optional) that of a spacecraft that turns, see
                               attitude.attitude_setting
              period           s, of the ADCS; a whole number of steps
              body             fields of vtff_dynamics.attitude.spacecraft.SpacecraftBody
              magnetometer, module, start, environment, thruster
                               fields of MagnetometerModel, AdcsModuleModel, AttitudeStart,
                               AttitudeEnvironment, AttitudeThruster
              propulsion       (optional) fields of BodyThrusters: thrust then acts along the axes
                               of the body, and thruster_errors are fixed in them
              faults           a list: {kind, start, end}

    Elements are osculating, in GCRF. ``longitude_of_ascending_node_deg`` is the Earth-fixed
    longitude of the node at the epoch.

    Parameters
    ----------
    path
        The YAML file.
    seed
        Replaces the seed of the file.
    number_of_deputies
        How many deputies an entry with ``repeat`` makes in all; 0 for as many as it says.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        If the file cannot be read or does not have this form.
    """
    return read_scenario(read_yaml(Path(path)), str(path), seed, number_of_deputies)


def read_scenario(
    fields: typing.Any, file: str, seed: int | None = None, number_of_deputies: int = 0
) -> Scenario:
    """Read the fields of a scenario file.

    Parameters
    ----------
    fields
        What the file holds; see `load_scenario`.
    file
        Name of the file for messages.
    seed
        Replaces the seed of the file.
    number_of_deputies
        As for `load_scenario`.

    Raises
    ------
    ScenarioError
        If the fields do not have the form of a scenario.
    """
    root = Section(file, "", repeat_spacecraft(fields, file, number_of_deputies))
    epoch = root.convert("epoch", lambda: parse_epoch(root.text("epoch")))
    force_model = _force_model(root.section("force_model"))
    seed_of_file = root.whole_number("seed")
    seed = seed_of_file if seed is None else seed
    drawn = None
    if "draw" in root:
        drawn = root.section("draw").make_dataclass(GeometryDraw).draw(seed)
        epoch = epoch + float(drawn.delay)
    spacecraft = _all_spacecraft(root.sections("spacecraft"), epoch, force_model)
    if drawn is not None:
        chief_gcrf = spacecraft[0].state_gcrf
        spacecraft = tuple(
            dataclasses.replace(craft, state_gcrf=drawn.turned(craft.state_gcrf, chief_gcrf))
            for craft in spacecraft
        )
    scenario = root.convert(
        "",
        lambda: Scenario(
            name=root.text("name"),
            description=root.text("description"),
            epoch=epoch,
            duration=root.number("duration"),
            seed=seed,
            force_model=force_model,
            integrator=root.choice("integrator", INTEGRATORS),
            step=root.number("step", minimum=1e-9),
            spacecraft=spacecraft,
            hard_radius=(
                root.number("hard_radius", minimum=0.0)
                if "hard_radius" in root
                else DEFAULT_HARD_RADIUS
            ),
        ),
    )
    root.finish()
    _check_separations(root, scenario)
    root.convert("", scenario.attitude_truths)
    return scenario


def _check_separations(root: Section, scenario: Scenario) -> None:
    """Refuse a formation that starts, or is meant to end, inside its own hard radius."""
    starts = {craft.name: craft.state_gcrf[:3] for craft in scenario.spacecraft}
    targets = {scenario.chief.name: np.zeros(3)}
    for craft in scenario.deputies:
        if craft.target_rtn is not None:
            targets[craft.name] = craft.target_rtn[:3]
    for positions, what in ((starts, "start"), (targets, "have targets")):
        for (first, at_first), (second, at_second) in itertools.combinations(positions.items(), 2):
            separation = float(np.linalg.norm(at_second - at_first))
            if separation < scenario.hard_radius:
                raise root.error(
                    "spacecraft",
                    f"{first} and {second} {what} {separation:.3g} m apart, inside the hard radius "
                    f"of {scenario.hard_radius:g} m",
                )


def state_ahead_on_orbit(state_gcrf: npt.ArrayLike, distance: float) -> FloatArray:
    """State on the same two-body orbit at a distance ahead (behind if negative).

    The distance is the straight line between the two at the same instant, in m: what a range
    measurement between them gives. For 1000 m on a low orbit the arc is 1 um longer.

    Parameters
    ----------
    state_gcrf
        Position (m) and velocity (m/s), shape (6,).
    distance
        Distance in m, less than the perigee radius.

    Returns
    -------
    ndarray, shape (6,)

    Raises
    ------
    ValueError
        If the orbit is not an ellipse or has no point at that distance.

    Notes
    -----
    Lagrange coefficients in the change of true anomaly (Curtis, Orbital Mechanics for Engineering
    Students, section 2.11); they have no singularity for circular or equatorial orbits. The change
    that gives the distance is found by bisection to the last bit.
    """
    state: FloatArray = np.array(state_gcrf, dtype=float)
    if distance == 0.0:
        return state
    sign = math.copysign(1.0, distance)

    def separation(change: float) -> float:
        return float(np.linalg.norm(_advance_true_anomaly(state, sign * change)[:3] - state[:3]))

    lower, upper = 0.0, math.pi / 3.0
    if not separation(upper) > abs(distance):
        raise ValueError(f"no point of the orbit is {abs(distance):g} m away along the orbit")
    while True:
        middle = 0.5 * (lower + upper)
        if middle in (lower, upper):
            return _advance_true_anomaly(state, sign * middle)
        if separation(middle) < abs(distance):
            lower = middle
        else:
            upper = middle


def _advance_true_anomaly(state: FloatArray, change: float) -> FloatArray:
    """Two-body state after a change of true anomaly in rad."""
    position, velocity = state[:3], state[3:]
    radius = float(np.linalg.norm(position))
    momentum = float(np.linalg.norm(np.cross(position, velocity)))
    if not (momentum > 0.0 and float(velocity @ velocity) * radius < 2.0 * GM_EARTH):
        raise ValueError("the orbit is not an ellipse")
    parameter = momentum**2 / GM_EARTH
    # 1 - cos, without cancellation for the small angles that are meant here.
    versine = 2.0 * math.sin(0.5 * change) ** 2
    sine = math.sin(change)
    radial_velocity = float(position @ velocity) / radius
    radius_new = parameter / (
        1.0
        + (parameter / radius - 1.0) * (1.0 - versine)
        - momentum * radial_velocity / GM_EARTH * sine
    )
    f = 1.0 - radius_new / parameter * versine
    g = radius * radius_new * sine / momentum
    f_dot = (
        GM_EARTH
        / momentum
        * math.tan(0.5 * change)
        * (versine / parameter - 1.0 / radius - 1.0 / radius_new)
    )
    g_dot = 1.0 - radius / parameter * versine
    return np.concatenate((f * position + g * velocity, f_dot * position + g_dot * velocity))


def _force_model(section: Section, base: ForceModel | None = None) -> ForceModel:
    """Return a force model from the fields that ForceModel declares; `base` has the others."""
    return section.make_dataclass(ForceModel, base)


def _all_spacecraft(
    sections: list[Section], epoch: GpsTime, force_model: ForceModel
) -> tuple[Spacecraft, ...]:
    """Build every spacecraft; the chief comes first, because orbits may refer to it."""
    spacecraft: list[Spacecraft] = []
    for index, section in enumerate(sections):
        name = section.text("name")
        if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
            raise section.error(
                "name", f"{name!r} is not made of lower-case letters, digits and underscores"
            )
        if name in SHARED_NAMESPACES:
            raise section.error("name", f"{name!r} is the namespace of topics that are not of one")
        if any(other.name == name for other in spacecraft):
            raise section.error("name", f"{name!r} is used twice")
        role = section.choice("role", ("chief", "deputy"))
        if (role == "chief") != (index == 0):
            raise section.error("role", "the first spacecraft, and only it, must be the chief")
        chief = spacecraft[0] if spacecraft else None
        state_gcrf = _orbit(section.section("orbit"), epoch, chief)
        target = None
        if chief is not None and "target" in section:
            target = _target(section.section("target"))
        own_force_model = None
        if "force_model" in section:
            own_force_model = _force_model(section.section("force_model"), force_model)
        thruster_errors = None
        if "thruster_errors" in section:
            thruster_errors = section.section("thruster_errors").make_dataclass(ThrusterErrorModel)
        attitude = None
        if "attitude" in section:
            attitude = _attitude(section.section("attitude"))
        section.finish()
        spacecraft.append(
            Spacecraft(name, role, state_gcrf, target, own_force_model, thruster_errors, attitude)
        )
    return tuple(spacecraft)


def _attitude(section: Section) -> AttitudeSetting:
    """Return the attitude of a spacecraft."""
    parts: dict[str, typing.Any] = {}
    for name, kind in _PARTS_OF_ATTITUDE.items():
        if name in section:
            parts[name] = section.section(name).make_dataclass(kind)
    if "faults" in section:
        parts["faults"] = tuple(
            fault.make_dataclass(AttitudeFault) for fault in section.sections("faults")
        )
    if "period" in section:
        parts["period"] = section.number("period", minimum=1e-3)
    section.finish()
    return section.convert("", lambda: AttitudeSetting(**parts))


def _orbit(section: Section, epoch: GpsTime, chief: Spacecraft | None) -> FloatArray:
    """Return the GCRF state at the epoch that an orbit section describes."""
    form = section.only_one_of("cartesian_gcrf", "elements", "same_orbit_ahead", "relative_rtn")
    if form == "cartesian_gcrf":
        cartesian = section.section(form)
        state = np.concatenate((cartesian.vector("position"), cartesian.vector("velocity")))
        cartesian.finish()
    elif form == "elements":
        state = _state_from_elements(section.section(form), epoch)
    elif chief is None:
        raise section.error(form, "the chief cannot be placed relative to itself")
    elif form == "relative_rtn":
        relative = section.section(form)
        position, velocity = relative.vector("position"), np.zeros(3)
        if "velocity" in relative:
            velocity = relative.vector("velocity")
        relative.finish()
        state = deputy_state_gcrf(chief.state_gcrf, np.concatenate((position, velocity)))
    else:
        distance = section.number(form)
        state = section.convert(form, lambda: state_ahead_on_orbit(chief.state_gcrf, distance))
    section.finish()
    if np.linalg.norm(state[:3]) < RADIUS_EARTH_JGM3:
        raise section.error(form, "the position is inside the Earth; is it in metres?")
    section.convert(form, lambda: rotation_gcrf_to_rtn(state))  # refuses a fall along the vertical
    return state


def _state_from_elements(section: Section, epoch: GpsTime) -> FloatArray:
    """Return the GCRF state of an elements section."""
    eccentricity = section.number("eccentricity", minimum=0.0)
    if not eccentricity < 1.0:
        raise section.error("eccentricity", f"less than 1 expected, got {eccentricity:g}")
    node = section.only_one_of("right_ascension_deg", "longitude_of_ascending_node_deg")
    right_ascension = math.radians(section.number(node))
    if node == "longitude_of_ascending_node_deg":
        right_ascension = right_ascension_from_longitude(epoch, right_ascension)
    anomaly = section.only_one_of("true_anomaly_deg", "mean_anomaly_deg")
    true_anomaly = math.radians(section.number(anomaly))
    if anomaly == "mean_anomaly_deg":
        true_anomaly = true_anomaly_from_mean(true_anomaly, eccentricity)
    semi_major_axis = section.number("semi_major_axis", minimum=RADIUS_EARTH_JGM3)
    inclination = math.radians(section.number("inclination_deg"))
    argument_of_perigee = math.radians(section.number("argument_of_perigee_deg"))
    section.finish()
    elements = section.convert(
        "",
        lambda: ClassicalElements(
            semi_major_axis=semi_major_axis,
            eccentricity=eccentricity,
            inclination=inclination,
            right_ascension=right_ascension,
            argument_of_perigee=argument_of_perigee,
            true_anomaly=true_anomaly,
        ),
    )
    return elements.to_state()


def _target(section: Section) -> FloatArray:
    """Return the target of a deputy, shape (6,)."""
    for name in section.names:
        if re.match(r"(position|velocity)_", name) and not name.endswith("_relative_rtn"):
            raise section.error(
                name, "a target is relative to the chief in its RTN frame: position_relative_rtn"
            )
    position = section.vector("position_relative_rtn")
    velocity = np.zeros(3)
    if "velocity_relative_rtn" in section:
        velocity = section.vector("velocity_relative_rtn")
    section.finish()
    return np.concatenate((position, velocity))
