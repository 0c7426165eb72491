"""The cases of a campaign: every combination of values, samples and seeds, in a fixed order."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vtff_bringup.campaign.campaign_file import Campaign
from vtff_bringup.campaign.variables import Variable, sample_variables

__all__ = ["Case", "case_identity", "make_cases"]

# Branches of the campaign's seed sequence, see numpy.random.SeedSequence.
_CASE_BRANCH, _SAMPLE_BRANCH = 0, 1

_LARGEST_SEED = 2**31 - 1
"""Seeds of cases fit every seed of the system: ROS parameters are signed."""


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes
    ----------
    number
        From 1, in the order of the campaign.
    seed
        Seed of its random streams.
    inputs
        Value of every variable by its name.
    settings
        Value by key, of what the variables set.
    """

    number: int
    seed: int
    inputs: Mapping[str, Any]
    settings: Mapping[str, Any]

    @property
    def identity(self) -> str:
        """Text that is the same for cases with the same inputs and seed, whatever their number."""
        return case_identity(self.seed, self.inputs)


def case_identity(seed: int, inputs: Mapping[str, Any]) -> str:
    """Return the identity of a case of a campaign, see `Case.identity`."""
    return json.dumps([seed, dict(inputs)], sort_keys=True)


def make_cases(campaign: Campaign) -> list[Case]:
    """Return the cases of a campaign.

    Lists and ranges form a grid, its first variable slowest; each of its points meets the same
    samples of the distributions, and each of these pairs each seed. A case depends on the file and
    on its number, never on what else is flown.

    Raises
    ------
    CampaignError
        If a distribution gives a value that is not finite.
    """
    listed = [variable for variable in campaign.variables if variable.values]
    sampled = [variable for variable in campaign.variables if variable.distribution is not None]
    samples: list[dict[str, Any]] = [{}]
    if sampled:
        sequence = np.random.SeedSequence(campaign.seed, spawn_key=(_SAMPLE_BRANCH,))
        try:
            samples = list(sample_variables(sampled, campaign.samples, campaign.design, sequence))
        except ValueError as error:
            raise campaign.error("vary", str(error)) from None
    cases = []
    repeats = range(campaign.seeds) if isinstance(campaign.seeds, int) else campaign.seeds
    combinations = itertools.product(list(_grid(listed)), samples, repeats)
    for number, (point, sample, repeat) in enumerate(combinations, 1):
        own_seed = isinstance(campaign.seeds, int)
        seed = _case_seed(campaign.seed, number) if own_seed else repeat
        inputs = {v.name: {**point, **sample}[v.name] for v in campaign.variables}
        settings = {key: inputs[v.name] for v in campaign.variables for key in v.keys}
        cases.append(Case(number, seed, inputs, settings))
    return cases


def _grid(listed: Sequence[Variable]) -> Iterator[dict[str, Any]]:
    """Yield the points of the grid of all lists."""
    axes = [variable for variable in listed if not variable.partner]
    for places in itertools.product(*(range(len(axis.values)) for axis in axes)):
        place = {axis.name: index for axis, index in zip(axes, places, strict=True)}
        yield {v.name: v.values[place[v.partner or v.name]] for v in listed}


def _case_seed(campaign_seed: int, number: int) -> int:
    sequence = np.random.SeedSequence(campaign_seed, spawn_key=(_CASE_BRANCH, number))
    return int(sequence.generate_state(1)[0]) & _LARGEST_SEED
