"""The report of a campaign that has been flown."""

from __future__ import annotations

import pathlib
from typing import Any

from vtff_analysis.studies.campaign_report import CampaignDescription, render_campaign_report
from vtff_bringup.campaign.campaign import CampaignResult, PreparedCampaign
from vtff_bringup.campaign.results import make_table, replace_file

__all__ = ["REPORT_FILE", "write_report"]

REPORT_FILE = "report.html"


def write_report(prepared: PreparedCampaign, result: CampaignResult, command: str) -> pathlib.Path:
    """Write the report of a campaign into its folder.

    Parameters
    ----------
    prepared, result
        The campaign.
    command
        Command that flies it, to which the number of a case can be added.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    campaign = prepared.campaign
    description = CampaignDescription(
        name=campaign.name,
        description=campaign.description,
        inputs={variable.name: variable.unit for variable in campaign.variables},
        figures=campaign.figures,
        verdicts=result.verdicts,
        planned=len(prepared.cases),
        repeat=lambda number: f"{command} --case {number}",
        facts=_facts(prepared, result, command),
    )
    page = render_campaign_report(make_table(campaign, result.records), description)
    path = prepared.folder / REPORT_FILE
    replace_file(path, page.encode())
    return path


def _facts(
    prepared: PreparedCampaign, result: CampaignResult, command: str
) -> list[tuple[str, str]]:
    campaign = prepared.campaign
    facts = [
        ("command", command),
        ("system", campaign.system),
        ("loop", campaign.loop),
        (
            "duration",
            "as the scenario" if campaign.duration is None else f"{campaign.duration:g} s",
        ),
        ("seed of the campaign", str(campaign.seed)),
        ("version of vtff", _different(result, "vtff_version")),
        ("commit", _different(result, "git_commit")),
        ("machines", _different(result, "machine")),
    ]
    if any(variable.distribution is not None for variable in campaign.variables):
        facts.insert(5, ("samples", f"{campaign.samples}, {campaign.design}"))
    facts += [(f"fixed: {key}", str(value)) for key, value in campaign.fixed.items()]
    return facts


def _different(result: CampaignResult, name: str) -> str:
    values: set[Any] = {record[name] for record in result.records}
    return ", ".join(sorted(str(value) for value in values if value is not None)) or "not known"
