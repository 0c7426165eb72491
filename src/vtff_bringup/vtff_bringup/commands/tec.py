"""`vtff tec`: electron content from recorded observations."""

from __future__ import annotations

import contextlib
import pathlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from rich.console import Console
from rich.markup import escape

from vtff_bringup.commands.command_line import TableForm, command_line, folder_option
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import (
    describe_os_error,
    exit_with_error,
    print_error,
    print_note,
)
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE

if TYPE_CHECKING:
    from vtff_iono.bias.code_biases import CodeBiasTable


def tec(
    files: Annotated[
        list[pathlib.Path],
        typer.Argument(help="Observation files and bags, each processed by itself."),
    ],
    nav: Annotated[
        Optional[list[pathlib.Path]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(
            metavar="FILE",
            help="RINEX navigation file, log with ephemerides, or SP3 file; may be repeated.",
        ),
    ] = None,
    biases: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            metavar="FILE",
            help="Satellite biases: a Bias-SINEX or DCB file, repeated for files that complete "
            "each other (P1-P2 and P1-C1); 'broadcast' (group delays of the navigation message, "
            "the default) or 'none': nothing is removed, right only for signals without satellite "
            "biases. Real ones have them, and those of the emulated receivers too.",
        ),
    ] = None,
    allow_old_biases: Annotated[
        bool,
        typer.Option("--allow-old-biases", help="Use biases that are valid at another time."),
    ] = False,
    orbit: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(
            help="Orbit of the receiver, SP3 or OEM; default: its own fixes in a log or bag, "
            "else from its codes."
        ),
    ] = None,
    systems: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            metavar="LETTERS",
            help="Systems that are used, RINEX letters: G GPS, R GLONASS, E Galileo, C BeiDou, J "
            "QZSS; default: all that have orbits.",
        ),
    ] = None,
    form: TableForm = "parquet",
    plots: Annotated[
        bool, typer.Option("--plots/--no-plots", help="Draw a picture of each receiver.")
    ] = True,
    partial: Annotated[
        bool, typer.Option("--partial", help="Use a damaged RINEX file up to the damage.")
    ] = False,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for tables and plots; default: tec_DATE_TIME."),
    ] = None,
) -> None:
    """Compute electron content and scintillation of recordings.

    Absolute slant and vertical TEC, ROTI, S4 and sigma phi of recorded receivers. Files: RINEX 2,
    3 or 4, Compact RINEX (Hatanaka), NovAtel logs, any of them compressed, and bags with
    /NAME/gnss/high_rate or /NAME/gnss/epoch. Receivers on the ground or in orbit; a receiver
    without a stated position is located by its fixes or codes. The receiver bias is estimated,
    with a sigma. Of several codes on a carrier those are used whose satellite biases are known. A
    file that cannot be used is reported, the others are processed; the exit code is then 1, and 2
    if none can be used. As many receivers as there are processors are processed at once.

    For example:

    vtff tec BELE.crx.gz --nav BRDC.rnx.gz --biases CAS.BIA.gz

    vtff tec day*.obs --nav brdc.rnx --format csv --out tec_of_march

    vtff tec leo.10o --nav igs.sp3 --orbit leo.sp3 --biases P1P2.DCB --biases P1C1.DCB
    """
    # Imported here, because numpy, compiled loops and matplotlib take a while.
    from rich.progress import Progress

    from vtff_analysis.page.results import Section, write_results
    from vtff_analysis.tec.batch import TecOptions, TecOutcome, find_tasks, run_tasks
    from vtff_analysis.tec.output import summary_rows, write_summary
    from vtff_analysis.tec.receiver_orbit import open_receiver_orbit
    from vtff_bag.run.folder import output_folder, remove_if_empty
    from vtff_gnss.files.navigation_files import open_navigation

    if plots:
        from vtff_analysis.tec.plots import write_plots
    console = make_console()
    with _exit_on_bad_file(console):
        if systems is not None:
            _check_systems(systems)
        navigation = open_navigation(nav or [], systems=systems)
        satellite_biases = _read_biases(biases or ["broadcast"])
        receiver_orbit = None if orbit is None else open_receiver_orbit(orbit)
        folder = output_folder(out, "tec")
    for remark in navigation.remarks:
        print_note(console, remark)
    summaries: list[dict[str, Any]] = []
    sections = []
    failed = 0
    is_unwritten = False
    entries = find_tasks(files)
    tasks = [entry for entry in entries if not isinstance(entry, TecOutcome)]
    options = TecOptions(
        folder,
        form,
        navigation,
        satellite_biases,
        partial,
        receiver_orbit,
        allow_old_biases,
        write_plots if plots else None,
        systems,
    )

    with (
        run_tasks(tasks, options) as outcomes,
        Progress(console=console, transient=True, disable=not console.is_interactive) as bar,
    ):
        progress = bar.add_task("receivers", total=len(entries))
        for entry in entries:
            outcome = entry if isinstance(entry, TecOutcome) else next(outcomes)
            if outcome.summary is None:
                print_error(console, outcome.error or "")
                failed += 1
                is_unwritten |= outcome.is_unwritten
            else:
                _print_summary(console, outcome.summary)
                summaries.append(outcome.summary)
                picture = (folder / f"{outcome.task.name}_tec.png", "Content and its rates.")
                sections.append(
                    Section(
                        outcome.summary["source"],
                        ("", ""),
                        summary_rows(outcome.summary),
                        [picture] if plots else [],
                        outcome.summary["remarks"],
                    )
                )
            bar.advance(progress)
    if not summaries:
        remove_if_empty(folder)
        raise typer.Exit(EXIT_FAILURE if is_unwritten else EXIT_USAGE)
    lead = _lead_sentence(summaries, failed)
    command = command_line(without="--out")
    try:
        write_summary(summaries, folder / "tec.json")
        write_results(folder / "tec.html", "Electron content", sections, command=command, lead=lead)
    except OSError as error:
        raise exit_with_error(console, describe_os_error(error, folder), EXIT_FAILURE) from error
    console.print(f"{len(summaries)} receivers, {failed} failed; folder: {folder}", markup=False)
    if failed:
        raise typer.Exit(EXIT_FAILURE)


def _check_systems(letters: str) -> None:
    """Raise TecError unless letters name systems."""
    from vtff_analysis.tec.errors import TecError
    from vtff_gnss.constants import SYSTEM_LETTERS

    if not letters or not set(letters) <= set(SYSTEM_LETTERS):
        raise TecError(f"--systems {letters!r}: letters out of {SYSTEM_LETTERS} are required")


@contextlib.contextmanager
def _exit_on_bad_file(console: Console) -> Iterator[None]:
    """End the command with one line and exit code 2 if a file cannot be used."""
    from vtff_analysis.tec.errors import TecError
    from vtff_bag.run.folder import RunFolderError
    from vtff_gnss.files.observation_files import ObservationFileError
    from vtff_iono.bias.code_biases import BiasFileError

    try:
        yield
    except (ObservationFileError, BiasFileError, TecError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise exit_with_error(console, describe_os_error(error), EXIT_USAGE) from error


def _read_biases(names: list[str]) -> str | CodeBiasTable:
    """Return the joined biases of some files, or the one word that stands for them.

    Raises
    ------
    BiasFileError
        If a file is no bias file, or stands beside such a word.
    OSError
        If a file cannot be read.
    """
    from vtff_iono.bias.bias_files import read_code_biases
    from vtff_iono.bias.code_biases import BiasFileError, CodeBiasTable

    words = [name for name in names if name in ("broadcast", "none")]
    if words and len(names) > 1:
        raise BiasFileError(f"--biases {words[0]}: not together with other biases")
    if words:
        return words[0]
    return CodeBiasTable.joined([read_code_biases(name) for name in names])


def _lead_sentence(summaries: list[dict[str, Any]], failed: int) -> str:
    """Return the result of all receivers in one sentence."""
    count = "1 receiver" if len(summaries) == 1 else f"{len(summaries)} receivers"
    vertical = [summary["vtec_tecu"] for summary in summaries if summary["vtec_tecu"]]
    content = "no electron content could be told"
    if vertical:
        least = min(range_of_receiver["minimum"] for range_of_receiver in vertical)
        most = max(range_of_receiver["maximum"] for range_of_receiver in vertical)
        content = f"vertical TEC {least:.1f} to {most:.1f} TECU"
    return f"{count}{f', {failed} failed' if failed else ''}: {content}."


def _print_summary(console: Console, summary: dict[str, Any]) -> None:
    console.print(
        f"{summary['source']}: {summary['good_samples']} of {summary['samples']} samples good",
        markup=False,
        soft_wrap=True,
    )
    for bias in summary["receiver_biases"]:
        console.print(
            f"  receiver bias {bias['pair']}: {bias['bias_ns']:.2f} +- {bias['sigma_ns']:.2f} ns",
            markup=False,
        )
    if summary["vtec_tecu"]:
        vertical = summary["vtec_tecu"]
        console.print(
            f"  vertical TEC {vertical['minimum']:.1f} to {vertical['maximum']:.1f} TECU, "
            f"median {vertical['median']:.1f}",
            markup=False,
        )
    for remark in summary["remarks"]:
        console.print(f"  [yellow]note:[/yellow] {escape(remark)}", soft_wrap=True)
