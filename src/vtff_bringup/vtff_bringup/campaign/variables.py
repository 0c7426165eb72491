"""Variables of a campaign: lists, ranges and distributions, and the designs that sample them."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.stats import qmc

from vtff_sim_bridge.truth.scenario_fields import Section

__all__ = ["DESIGNS", "SPACINGS", "Variable", "read_variable", "sample_variables"]

DESIGNS = ("random", "latin_hypercube", "sobol")
"""Ways to spread samples over several distributions."""

SPACINGS = ("linear", "logarithmic")
"""Ways to spread values over a range."""

_FIELDS = {"sets", "unit", "values", "with", "from", "to", "count", "spacing", "distribution"}


@dataclass(frozen=True)
class Variable:
    """One thing that differs from case to case.

    Attributes
    ----------
    name
        Name of its column in the table.
    keys
        What it sets: arguments of the system, ``node.parameter``, or ``argument.path`` for an
        entry of the file that an argument names.
    unit
        Unit for labels; empty for none.
    values
        Its values in order; empty for a distribution.
    partner
        Variable whose values go with these one by one; empty where every value meets every value
        of the other variables.
    distribution
        Frozen distribution of scipy.stats; None for values.
    """

    name: str
    keys: tuple[str, ...]
    unit: str
    values: tuple[Any, ...] = ()
    partner: str = ""
    distribution: Any = None

    def quantiles(self, probability: npt.ArrayLike) -> list[float | int]:
        """Return the values of the distribution at probabilities, shape (n,)."""
        with np.errstate(over="ignore"):  # the caller refuses numbers that are not finite
            values = np.asarray(self.distribution.ppf(probability))
        if hasattr(self.distribution.dist, "pmf"):
            return [int(value) for value in values]
        return [float(value) for value in values]


def read_variable(section: Section, name: str) -> Variable:
    """Read one entry of ``vary``: a list of values, or a mapping.

    Raises
    ------
    ScenarioError
        Naming file and field.
    """
    content = section.value(name)
    if isinstance(content, list):
        return Variable(name, (name,), "", _listed(section, name, content))
    entry = section.section(name)
    keys = _texts(entry, "sets") if "sets" in entry else (name,)
    unit = entry.text("unit") if "unit" in entry else ""
    form = entry.only_one_of("values", "from", "distribution")
    if form == "distribution":
        return Variable(name, keys, unit, distribution=_distribution(entry))
    if form == "values":
        values = _listed(entry, "values", entry.value("values"))
        partner = entry.text("with") if "with" in entry else ""
        entry.finish()
        return Variable(name, keys, unit, values, partner)
    return Variable(name, keys, unit, _range(entry))


def sample_variables(
    variables: Sequence[Variable], count: int, design: str, seed: np.random.SeedSequence
) -> list[dict[str, float | int]]:
    """Sample distributions.

    Parameters
    ----------
    variables
        Variables with a distribution.
    count
        Number of samples; a power of two with ``sobol``.
    design
        One of `DESIGNS`.
    seed
        Seed of the samples.

    Returns
    -------
    list of dict
        Value by name of the variable, one dict a sample.

    Raises
    ------
    ValueError
        If a distribution gives a value that is not finite.
    """
    generator = np.random.default_rng(seed)
    if design == "sobol":
        points = qmc.Sobol(len(variables), scramble=True, seed=generator).random(count)
    elif design == "latin_hypercube":
        points = qmc.LatinHypercube(len(variables), seed=generator).random(count)
    else:
        points = generator.random((count, len(variables)))
    columns = {}
    for variable, probabilities in zip(variables, points.T, strict=True):
        values = variable.quantiles(probabilities)
        if not np.isfinite(values).all():
            raise ValueError(f"{variable.name}: the distribution gives a value that is not finite")
        columns[variable.name] = values
    return [{name: values[row] for name, values in columns.items()} for row in range(count)]


def _listed(section: Section, name: str, values: Any) -> tuple[Any, ...]:
    if not isinstance(values, list) or not values:
        raise section.error(name, f"a list of one or more values expected, got {values!r}")
    return tuple(values)


def _texts(section: Section, name: str) -> tuple[str, ...]:
    values = _listed(section, name, section.value(name))
    for value in values:
        if not isinstance(value, str) or not value:
            raise section.error(name, f"a list of texts expected, got {value!r}")
    return values


def _range(entry: Section) -> tuple[float, ...]:
    """Return evenly spread values from one end to the other."""
    first, last, count = entry.number("from"), entry.number("to"), entry.whole_number("count")
    spacing = entry.choice("spacing", SPACINGS) if "spacing" in entry else "linear"
    entry.finish()
    if count < 2:
        raise entry.error("count", f"2 or more expected, got {count}")
    if spacing == "linear":
        return tuple(np.linspace(first, last, count).tolist())
    if not (first > 0.0 and last > 0.0):
        raise entry.error("spacing", "logarithmic needs 'from' and 'to' above 0")
    return tuple(np.geomspace(first, last, count).tolist())


def _distribution(entry: Section) -> Any:
    """Return the frozen distribution of scipy.stats that an entry describes."""
    name = entry.text("distribution")
    family = getattr(stats, name, None)
    if not isinstance(family, (stats.rv_continuous, stats.rv_discrete)):
        raise entry.error("distribution", f"scipy.stats has no distribution {name!r}")
    names = [*_shape_names(family), "loc"]
    if isinstance(family, stats.rv_continuous):
        names.append("scale")
    given = {name: entry.number(name) for name in names if name in entry}
    missing = [shape for shape in _shape_names(family) if shape not in given]
    if missing:
        raise entry.error(missing[0], f"field is missing; {name} takes {', '.join(names)}")
    entry.finish()
    frozen = family(**given)
    if not np.isfinite(frozen.ppf(0.5)):
        text = ", ".join(f"{key} = {value:g}" for key, value in given.items())
        raise entry.error("distribution", f"{name} has no values for {text}")
    return frozen


def _shape_names(family: Any) -> list[str]:
    """Return the names of the shape parameters of a distribution."""
    if family.shapes:
        return [name.strip() for name in family.shapes.split(",")]
    signature = inspect.signature(family._parse_args)
    return [name for name in signature.parameters if name not in ("loc", "scale", "args", "kwds")]
