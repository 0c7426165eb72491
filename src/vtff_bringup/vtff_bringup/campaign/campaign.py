"""A campaign from its file to its table: fly what is not yet flown, and judge the bounds."""

from __future__ import annotations

import dataclasses
import pathlib
import shutil
import time
from collections.abc import Callable, Sequence
from typing import Any

from vtff_analysis.studies.bounds import Verdict, judge_bound
from vtff_bringup.campaign.campaign_file import Campaign, CampaignError
from vtff_bringup.campaign.cases import Case, make_cases
from vtff_bringup.campaign.checks import plan_flights
from vtff_bringup.campaign.cluster import RemoteCluster, connected_client
from vtff_bringup.campaign.execution import fly_campaign
from vtff_bringup.campaign.plan import FlightPlan
from vtff_bringup.campaign.results import (
    JOURNAL_FILE,
    Journal,
    check_fingerprint,
    make_table,
    write_table,
)
from vtff_bringup.campaign.worker import COMPLETE, RUNS_FOLDER

__all__ = ["KEEP", "CampaignResult", "Execution", "PreparedCampaign", "prepare_campaign"]

KEEP = ("bags", "failed", "none")
"""Which run folders stay: all, those of failed cases, or none."""

_SCRATCH_FOLDER = ".workers"


@dataclasses.dataclass(frozen=True)
class Execution:
    """Settings of the flight of a campaign; no setting changes a number.

    Attributes
    ----------
    workers
        Workers of the cluster on this machine.
    remote
        Another Dask cluster to fly on; None for one on this machine.
    resume
        Whether the folder may hold finished cases of this campaign.
    batch
        Cases of a task of Dask.
    """

    workers: int
    remote: RemoteCluster | None = None
    resume: bool = False
    batch: int = 1


@dataclasses.dataclass(frozen=True, eq=False)
class CampaignResult:
    """Result of a campaign.

    Attributes
    ----------
    records
        Record of every case that was flown, in the order of their numbers.
    verdicts
        On the bounds, in the order of the file.
    wall_time
        Seconds that this command flew.
    """

    records: list[dict[str, Any]]
    verdicts: list[Verdict]
    wall_time: float

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Records of the cases that did not come to their end."""
        return [record for record in self.records if record["status"] != COMPLETE]

    @property
    def holds(self) -> bool:
        """Whether every case came to its end and every bound holds."""
        return not self.failed and all(verdict.holds for verdict in self.verdicts)


@dataclasses.dataclass(frozen=True)
class PreparedCampaign:
    """A campaign that has been checked: it can be flown.

    Attributes
    ----------
    campaign
        As read from its file.
    cases
        Its cases.
    plan
        Plan that the workers get.
    folder
        Where its results go.
    """

    campaign: Campaign
    cases: Sequence[Case]
    plan: FlightPlan
    folder: pathlib.Path

    def fly(
        self,
        execution: Execution,
        on_start: Callable[[int, str], None] | None = None,
        on_record: Callable[[dict[str, Any]], None] | None = None,
    ) -> CampaignResult:
        """Fly the cases that are not yet finished; write journal and table.

        Parameters
        ----------
        execution
            How.
        on_start
            Called with the number of cases that are finished already and the address of the
            dashboard.
        on_record
            Called with the record of each case that is done.

        Raises
        ------
        CampaignError
            If the folder holds another campaign.
        ClusterError
            If the cluster cannot be reached or is lost; the finished cases are kept.
        OSError
            If a result cannot be written; the finished cases are kept.
        KeyboardInterrupt
            Passed on; the finished cases are kept.
        """
        started = time.monotonic()
        if not execution.resume and (self.folder / JOURNAL_FILE).exists():
            raise CampaignError(
                f"{self.folder} already holds a campaign; go on with --resume, or choose "
                "another --out"
            )
        check_fingerprint(self.folder, self.campaign)
        with Journal(self.folder) as journal:
            try:
                self._fly_missing(execution, journal, on_start, on_record)
            except KeyboardInterrupt:
                # It may have come between the line of a case in the file and its entry in memory.
                journal.read_again()
                raise
            finally:
                records = self._records(journal)
                if records:
                    write_table(make_table(self.campaign, records), self.folder)
            self._tidy(journal)
        return CampaignResult(records, self._judge(records), time.monotonic() - started)

    def _records(self, journal: Journal) -> list[dict[str, Any]]:
        """Return the records of the cases that a journal has, in the order of their numbers."""
        records = (journal.record_of(case) for case in self.cases)
        return [record for record in records if record is not None]

    def _judge(self, records: Sequence[dict[str, Any]]) -> list[Verdict]:
        """Judge the bounds by the records of all cases."""
        return [
            judge_bound(bound, [record["figures"].get(bound.figure) for record in records])
            for bound in self.campaign.bounds
        ]

    def _fly_missing(
        self,
        execution: Execution,
        journal: Journal,
        on_start: Callable[[int, str], None] | None,
        on_record: Callable[[dict[str, Any]], None] | None,
    ) -> None:
        complete = {r["case"] for r in self._records(journal) if r["status"] == COMPLETE}
        missing = [case for case in self.cases if case.number not in complete]
        if not missing:
            if on_start is not None:
                on_start(len(complete), "")
            return
        scratch = self.folder / _SCRATCH_FOLDER
        workers = min(execution.workers, len(missing))
        try:
            with connected_client(execution.remote, workers, scratch) as client:
                if on_start is not None:
                    on_start(len(complete), str(client.dashboard_link or ""))

                def keep(record: dict[str, Any]) -> None:
                    journal.append(record)
                    if on_record is not None:
                        on_record(record)

                fly_campaign(client, self.plan, missing, keep, execution.batch)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    def _tidy(self, journal: Journal) -> None:
        """Take away run folders that no record names: of attempts before a resumption."""
        named = journal.run_folders()
        for folder in (self.folder / RUNS_FOLDER).glob("*"):
            if f"{RUNS_FOLDER}/{folder.name}" not in named:
                shutil.rmtree(folder, ignore_errors=True)


def prepare_campaign(campaign: Campaign, folder: pathlib.Path, keep: str) -> PreparedCampaign:
    """Make the cases of a campaign and check everything that can be checked before a flight.

    Raises
    ------
    CampaignError
        If something is wrong; one line that names file and field.
    """
    cases = make_cases(campaign)
    return PreparedCampaign(campaign, cases, plan_flights(campaign, cases, folder, keep), folder)
