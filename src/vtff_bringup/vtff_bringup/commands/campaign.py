"""`vtff campaign`: fly any run as a distribution."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import pathlib
import signal
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn, Optional

import typer
from rich.console import Console
from rich.markup import escape

from vtff_bag.run.folder import RunFolderError, output_folder, remove_if_empty
from vtff_bringup.commands.command_line import folder_option
from vtff_bringup.discover.completion import complete_campaign
from vtff_bringup.run.console import make_console
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE

if TYPE_CHECKING:
    from vtff_bringup.campaign.campaign import CampaignResult, Execution, PreparedCampaign
    from vtff_bringup.campaign.cases import Case
    from vtff_bringup.campaign.cluster import RemoteCluster

_MOST_LISTED = 10
_LINE_FRACTION = 0.1  # of the cases, between lines where there is no terminal


def campaign(
    file: Annotated[
        str,
        typer.Argument(
            help="Campaign file, or its name (vtff list campaigns), e.g. example.",
            autocompletion=complete_campaign,
        ),
    ],
    workers: Annotated[
        Optional[int],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(help="Workers on this machine; default: one for each core.", min=1),
    ] = None,
    scheduler: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            help="Fly on a running Dask cluster instead: tcp://HOST:PORT or tls://HOST:PORT."
        ),
    ] = None,
    tls_ca_file: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="With tls://: certificate of the authority (PEM).", exists=True),
    ] = None,
    tls_certificate: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="With tls://: own certificate (PEM).", exists=True),
    ] = None,
    tls_key: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="With tls://: key of that certificate (PEM).", exists=True),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder of the campaign; default: campaigns/NAME_DATE_TIME."),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on in --out: finished cases are not flown again."),
    ] = False,
    keep: Annotated[
        Literal["bags", "failed", "none"],
        typer.Option(help="Run folders that stay: all, those of failed cases, or none."),
    ] = "failed",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check the file and print its cases; fly nothing.")
    ] = False,
    case: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(help="Fly only the case of this number, and keep its run folder.", min=1),
    ] = None,
    batch: Annotated[
        int,
        typer.Option(help="Cases of a Dask task: more for short cases on many workers.", min=1),
    ] = 1,
) -> None:
    """Fly many cases of one system: a table and a report.

    Each case has other values. The file names a system, what is fixed, what is varied (lists,
    ranges, distributions), the figures to keep and the bounds that must hold. A case is a vtff run
    of its own or, with loop: library, the closed loop without ROS. docs/campaigns.md tells all
    fields.

    For example:

    vtff campaign example --dry-run: look at the cases first

    vtff campaign example --workers 2: fly them

    vtff campaign example --out DIR --resume: go on after an interruption

    vtff campaign example --case 17: fly one case again, with its bag

    The folder holds cases.parquet (a row a case), report.html, cases.jsonl (the finished cases, as
    they came) and runs/ (what --keep keeps).

    Exit code: 0 every case complete and every bound holds, 1 a case failed or a bound does not
    hold, 2 the file or an option is wrong, 130 interrupted by Ctrl-C: finished cases are kept.
    """
    # Imported here, because numpy, scipy and ROS take a while.
    from vtff_bringup.campaign.campaign import Execution, prepare_campaign
    from vtff_bringup.campaign.campaign_file import (
        CampaignError,
        find_campaign_file,
        load_campaign,
    )

    console = make_console()
    folder: pathlib.Path | None = None
    try:
        remote = _remote(scheduler, tls_ca_file, tls_certificate, tls_key)
        path = find_campaign_file(file)
        loaded = load_campaign(path)
        if resume and out is None:
            raise CampaignError("--resume: give the folder of the campaign with --out")
        if dry_run:
            prepared = prepare_campaign(loaded, pathlib.Path.cwd(), keep)
        else:
            name = loaded.name if case is None else f"{loaded.name}_case_{case}"
            folder = output_folder(out, name, parent="campaigns", empty=case is not None)
            prepared = prepare_campaign(loaded, folder, keep if case is None else "bags")
        chosen = None if case is None else _chosen_case(prepared, case)
    except (CampaignError, RunFolderError) as error:
        if folder is not None:
            remove_if_empty(folder)
        stop(console, error, EXIT_USAGE)
    if dry_run:
        _print_cases(prepared, chosen)
        return
    if chosen is not None:
        raise typer.Exit(_fly_one(console, prepared, chosen))
    execution = Execution(workers or os.cpu_count() or 1, remote, resume, batch)
    again = f"vtff campaign {file} --out {folder} --resume"
    result = fly_campaign_visibly(console, prepared, execution, again)
    _write_report(console, prepared, result, file)
    raise typer.Exit(conclude_campaign(console, prepared, result))


def fly_campaign_visibly(
    console: Console, prepared: PreparedCampaign, execution: Execution, again: str
) -> CampaignResult:
    """Fly a campaign with its progress on the console.

    Parameters
    ----------
    console
        Where progress and errors go.
    prepared, execution
        Campaign to fly, and how to fly it.
    again
        Command that goes on after an interruption.

    Raises
    ------
    typer.Exit
        After an error has been printed.
    """
    from vtff_bringup.campaign.campaign_file import CampaignError
    from vtff_bringup.campaign.cluster import ClusterError

    campaign_name = f"[bold]{escape(prepared.campaign.name)}[/bold]"
    console.print(f"{campaign_name}: {escape(prepared.campaign.description)}", soft_wrap=True)
    progress = _Progress(console, len(prepared.cases))
    try:
        with _terminated_as_interrupted(), progress:
            return prepared.fly(execution, progress.start, progress.count)
    except CampaignError as error:
        stop(console, error, EXIT_USAGE)
    except (ClusterError, OSError) as error:
        kept = f"{progress.done} of {progress.total} cases are kept; go on with: {again}"
        stop(console, f"{_one_line(error)}; {kept}", EXIT_FAILURE)
    except KeyboardInterrupt:
        console.print(
            f"[red]interrupted[/red]; {progress.done} of {progress.total} cases are kept; "
            f"go on with: {escape(again)}",
            soft_wrap=True,
        )
        raise typer.Exit(EXIT_INTERRUPTED) from None


def conclude_campaign(console: Console, prepared: PreparedCampaign, result: CampaignResult) -> int:
    """Print failed cases, bounds and the folder; return the exit code."""
    failed = result.failed
    if failed:
        console.print(f"[red]{len(failed)} of {len(result.records)} cases failed:[/red]")
        for record in failed[:_MOST_LISTED]:
            text = f"  case {record['case']}: {record['status']}: {record['reason']}"
            console.print(text, markup=False, soft_wrap=True)
        if len(failed) > _MOST_LISTED:
            console.print(f"  and {len(failed) - _MOST_LISTED} more, see the table")
    for verdict in result.verdicts:
        colour = "green" if verdict.holds else "red"
        console.print(f"[{colour}]must:[/{colour}] {escape(str(verdict))}", soft_wrap=True)
    complete = len(result.records) - len(failed)
    console.print(f"{complete} of {len(prepared.cases)} cases complete, {result.wall_time:.1f} s")
    console.print(f"campaign: {prepared.folder}", markup=False, soft_wrap=True)
    return 0 if result.holds else EXIT_FAILURE


def stop(console: Console, error: object, exit_code: int) -> NoReturn:
    """Print an error on one line and end the command."""
    console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
    raise typer.Exit(exit_code)


class _Progress:
    """Cases done and time left: a bar on a terminal, else a line for every tenth."""

    def __init__(self, console: Console, total: int) -> None:
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        self._console = console
        self.total = total
        self.done = 0
        self._failed = 0
        self._next_line = _LINE_FRACTION
        self._bar: Progress | None = None
        if console.is_interactive:
            self._bar = Progress(
                BarColumn(bar_width=30),
                MofNCompleteColumn(),
                TextColumn("{task.description}"),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
                console=console,
                transient=True,
            )
            self._task = self._bar.add_task("starting", total=total)

    def __enter__(self) -> _Progress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *unused: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def start(self, finished: int, dashboard: str) -> None:
        """Tell what is there already, and where the dashboard is."""
        self.done = finished
        if finished:
            self._console.print(f"{finished} of {self.total} cases are finished already")
            self._next_line += finished / self.total
        if dashboard:
            # Dask draws its pages with bokeh, which set-up leaves out for its size.
            has_pages = importlib.util.find_spec("bokeh") is not None
            hint = "" if has_pages else " (its pages need: pip install bokeh)"
            self._console.print(f"dashboard: {dashboard}{hint}", markup=False, soft_wrap=True)
        self._show()

    def count(self, record: dict[str, Any]) -> None:
        """Count a case that is done."""
        from vtff_bringup.campaign.worker import COMPLETE

        if record["status"] == COMPLETE:
            self.done += 1
        else:
            self._failed += 1
        self._show()

    def _show(self) -> None:
        over = self.done + self._failed
        failed = f"{self._failed} failed" if self._failed else ""
        if self._bar is not None:
            self._bar.update(self._task, completed=over, description=failed)
        elif over / self.total >= self._next_line:
            self._next_line += _LINE_FRACTION
            self._console.print(f"  {over} of {self.total} cases {failed}".rstrip())


@contextlib.contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Let SIGTERM, with which batch systems end jobs, do what Ctrl-C does."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def _remote(
    scheduler: str | None,
    ca_file: pathlib.Path | None,
    certificate: pathlib.Path | None,
    key: pathlib.Path | None,
) -> RemoteCluster | None:
    from vtff_bringup.campaign.campaign_file import CampaignError
    from vtff_bringup.campaign.cluster import RemoteCluster

    tls = {"--tls-ca-file": ca_file, "--tls-certificate": certificate, "--tls-key": key}
    given = [name for name, value in tls.items() if value is not None]
    if scheduler is None or not scheduler.startswith("tls://"):
        if given:
            raise CampaignError(f"{given[0]}: only with --scheduler tls://HOST:PORT")
        if scheduler is None:
            return None
        if not scheduler.startswith("tcp://"):
            raise CampaignError(
                f"--scheduler: tcp://HOST:PORT or tls://HOST:PORT expected, got {scheduler!r}"
            )
    elif len(given) < len(tls):
        missing = next(name for name, value in tls.items() if value is None)
        raise CampaignError(f"{missing}: missing; tls:// needs {', '.join(tls)}")
    return RemoteCluster(scheduler, ca_file, certificate, key)


def _chosen_case(prepared: PreparedCampaign, number: int) -> Case:
    from vtff_bringup.campaign.campaign_file import CampaignError

    if number > len(prepared.cases):
        raise CampaignError(f"--case: the campaign has {len(prepared.cases)} cases, got {number}")
    return prepared.cases[number - 1]


def _print_cases(prepared: PreparedCampaign, chosen: Case | None) -> None:
    """Print the cases as a table with tabs."""
    names = [variable.name for variable in prepared.campaign.variables]
    rows = [["case", "seed", *names]]
    for case in prepared.cases if chosen is None else [chosen]:
        rows.append([str(case.number), str(case.seed), *(f"{case.inputs[n]}" for n in names)])
    for row in rows:
        typer.echo("\t".join(row))


def _fly_one(console: Console, prepared: PreparedCampaign, case: Case) -> int:
    """Fly one case in this process and print its record."""
    from vtff_bringup.campaign.worker import COMPLETE, fly_cases

    try:
        with _terminated_as_interrupted():
            (record,) = fly_cases(prepared.plan, [case])
    except KeyboardInterrupt:
        console.print("[red]interrupted[/red]")
        return EXIT_INTERRUPTED
    for name, value in {**record["inputs"], "seed": case.seed, **record["figures"]}.items():
        console.print(f"{name}: {value}", markup=False, soft_wrap=True)
    if record["run_folder"]:
        console.print(
            f"run: {prepared.folder / record['run_folder']}", markup=False, soft_wrap=True
        )
    else:
        remove_if_empty(prepared.folder)
    if record["status"] != COMPLETE:
        stop(console, f"case {case.number}: {record['status']}: {record['reason']}", EXIT_FAILURE)
    return 0


def _write_report(
    console: Console, prepared: PreparedCampaign, result: CampaignResult, file: str
) -> None:
    from vtff_bringup.campaign.report import write_report

    try:
        page = write_report(prepared, result, f"vtff campaign {file}")
    except OSError as error:
        stop(console, f"no report: {_one_line(error)}", EXIT_FAILURE)
    console.print(f"report: {page}", markup=False, soft_wrap=True)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
