"""Campaign files (``config/campaign/*.yaml``): what is flown, what is varied, what is kept.

A campaign file is read strictly: everything wrong is a `CampaignError` of one line that names the
file and the field, before anything is flown. docs/campaigns.md describes the fields.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from vtff_analysis.studies.bounds import Bound, read_bound
from vtff_bringup.campaign.variables import DESIGNS, Variable, read_variable
from vtff_node.executables import ExecutableNotFoundError, share_folder
from vtff_sim_bridge.truth.scenario_fields import ScenarioError, Section, read_yaml

__all__ = ["LOOPS", "Campaign", "CampaignError", "find_campaign_file", "load_campaign"]

LOOPS = ("run", "library")
"""Program that flies a case: `vtff run`, or the closed loop without ROS."""

_RESERVED_COLUMNS = frozenset(
    (
        *("case", "status", "seed", "wall_time_s", "processor_time_s"),
        *("vtff_version", "git_commit", "machine", "run_folder", "reason"),
    )
)
"""Columns of the table that are not inputs or figures, see `vtff_bringup.campaign.results`."""


class CampaignError(ValueError):
    """A campaign that cannot be flown; the text names file and field."""


@dataclass(frozen=True)
class Campaign:
    """Contents of a campaign file.

    Attributes
    ----------
    path
        The file.
    description
        One line.
    system
        Name or path of the system file.
    loop
        One of `LOOPS`.
    duration
        Scenario seconds of each case; None as the scenario says.
    timeout
        Wall seconds after which a case counts as hanging; None for the default.
    composed
        Whether the nodes of a run share one process.
    seed
        Seed of the campaign: samples and seeds of the cases come from it.
    seeds
        Number of seeds of each combination, each a new one, or the seeds themselves, the same for
        every combination.
    samples, design
        Number of samples of the distributions, and how they are spread.
    fixed
        Value by key (argument, ``node.parameter`` or ``argument.path``), the same in every case.
    variables
        Variables: inputs that differ from case to case.
    figures
        Names of the figures to keep.
    bounds
        Bounds on figures.
    """

    path: pathlib.Path
    description: str
    system: str
    loop: str = "run"
    duration: float | None = None
    timeout: float | None = None
    composed: bool = True
    seed: int = 1
    seeds: int | tuple[int, ...] = 1
    samples: int = 1
    design: str = "random"
    fixed: Mapping[str, Any] = field(default_factory=dict)
    variables: tuple[Variable, ...] = ()
    figures: tuple[str, ...] = ()
    bounds: tuple[Bound, ...] = ()

    @property
    def name(self) -> str:
        """Name of the campaign: its file name without ending."""
        return self.path.stem

    def error(self, place: str, problem: str) -> CampaignError:
        """Return the error for a field of the file."""
        return CampaignError(": ".join(part for part in (str(self.path), place, problem) if part))


def find_campaign_file(name: str) -> pathlib.Path:
    """Return the campaign file of a path, or of a name in config/campaign.

    Raises
    ------
    CampaignError
        If there is none; the text lists the names there are.
    """
    path = pathlib.Path(name)
    if os.path.isfile(path):
        return path
    folders = [pathlib.Path("config/campaign")]
    with contextlib.suppress(ExecutableNotFoundError):
        folders.append(share_folder("vtff_bringup") / "config/campaign")
    for folder in folders:
        if os.path.isfile(folder / f"{name}.yaml"):
            return folder / f"{name}.yaml"
    names = sorted({file.stem for folder in folders for file in folder.glob("*.yaml")})
    raise CampaignError(f"no campaign file '{name}'; there are: {', '.join(names) or 'none'}")


def load_campaign(path: pathlib.Path, overrides: Mapping[str, Any] | None = None) -> Campaign:
    """Read a campaign file.

    Parameters
    ----------
    path
        The YAML file.
    overrides
        Fields that replace those of the file, by name.

    Raises
    ------
    CampaignError
        If the file cannot be read or does not have the form of a campaign file.
    """
    try:
        content = read_yaml(path)
        if isinstance(content, dict):
            content = {**content, **(overrides or {})}
        return _campaign(path, Section(str(path), "", content))
    except ScenarioError as error:
        raise CampaignError(str(error)) from None


def _campaign(path: pathlib.Path, root: Section) -> Campaign:
    variables = _variables(root)
    sampled = [variable for variable in variables if variable.distribution is not None]
    samples, design = 1, "random"
    if sampled:
        samples = _at_least_one(root, "samples")
        design = root.choice("design", DESIGNS) if "design" in root else "random"
        if design == "sobol" and samples & (samples - 1):
            raise root.error("samples", f"a power of two expected with sobol, got {samples}")
    for name in ("samples", "design"):
        if name in root and not sampled:
            raise root.error(name, "only with a distribution under 'vary'")
    figures = _figures(root)
    clashing = [variable.name for variable in variables if variable.name in figures]
    if clashing:
        raise root.error(f"vary.{clashing[0]}", "a variable may not have the name of a figure")
    campaign = Campaign(
        path=path,
        description=root.text("description") if "description" in root else "",
        system=root.text("system"),
        loop=root.choice("loop", LOOPS) if "loop" in root else "run",
        duration=_positive(root, "duration"),
        timeout=_positive(root, "timeout"),
        composed=_truth_value(root, "composed"),
        seed=root.whole_number("seed") if "seed" in root else 1,
        seeds=_seeds(root),
        samples=samples,
        design=design,
        fixed=_mapping(root, "fixed"),
        variables=variables,
        figures=figures,
        bounds=_bounds(root, figures),
    )
    root.finish()
    return campaign


def _variables(root: Section) -> tuple[Variable, ...]:
    names = _mapping(root, "vary")
    section = root.section("vary") if names else None
    variables = tuple(read_variable(section, name) for name in names) if section else ()
    by_name = {variable.name: variable for variable in variables}
    setters: dict[str, str] = {}
    for variable in variables:
        place = f"vary.{variable.name}"
        if variable.name in _RESERVED_COLUMNS:
            raise root.error(place, "the table has a column of this name already")
        for key in variable.keys:
            if key in setters:
                raise root.error(place, f"'{key}' is set by {setters[key]} already")
            setters[key] = variable.name
        if not variable.partner:
            continue
        partner = by_name.get(variable.partner)
        if partner is None or not partner.values or partner.partner:
            raise root.error(f"{place}.with", f"{variable.partner!r} is no list of this campaign")
        if len(partner.values) != len(variable.values):
            raise root.error(
                f"{place}.values",
                f"{len(partner.values)} values expected, as {partner.name} has, "
                f"got {len(variable.values)}",
            )
    return variables


def _figures(root: Section) -> tuple[str, ...]:
    figures = root.value("figures")
    if not isinstance(figures, list) or not figures:
        raise root.error("figures", f"a list of one or more names expected, got {figures!r}")
    for figure in figures:
        if not isinstance(figure, str):
            raise root.error("figures", f"a list of names expected, got {figure!r}")
        if figures.count(figure) > 1:
            raise root.error("figures", f"{figure!r} is given twice")
    return tuple(figures)


def _bounds(root: Section, figures: Sequence[str]) -> tuple[Bound, ...]:
    names = _mapping(root, "must")
    if not names:
        return ()
    section = root.section("must")
    for name in names:
        if name not in figures:
            raise section.error(name, "the figure of a bound must stand in 'figures'")
    return tuple(read_bound(section, name) for name in names)


def _seeds(root: Section) -> int | tuple[int, ...]:
    if "seeds" not in root:
        return 1
    seeds = root.value("seeds")
    if not isinstance(seeds, list):
        return _at_least_one(root, "seeds")
    whole = [isinstance(seed, int) and not isinstance(seed, bool) and seed >= 0 for seed in seeds]
    if not seeds or not all(whole):
        raise root.error("seeds", f"a count or a list of whole numbers expected, got {seeds!r}")
    return tuple(seeds)


def _at_least_one(root: Section, name: str) -> int:
    value = root.whole_number(name)
    if value < 1:
        raise root.error(name, f"1 or more expected, got {value}")
    return value


def _positive(root: Section, name: str) -> float | None:
    if name not in root:
        return None
    value = root.number(name)
    if value <= 0.0:
        raise root.error(name, f"more than 0 expected, got {value:g}")
    return value


def _truth_value(root: Section, name: str) -> bool:
    return bool(root.value_of_type(name, bool)) if name in root else True


def _mapping(root: Section, name: str) -> dict[str, Any]:
    """Return a mapping with texts as keys; empty where the field is absent."""
    if name not in root:
        return {}
    content = root.value(name)
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise root.error(name, f"a mapping of names to values expected, got {content!r}")
    return content
