"""`vtff tec`: electron content from recorded observations."""

from __future__ import annotations

import pathlib
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress

from vtff_bringup.run.errors import describe_os_error, exit_with_error, print_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE

if TYPE_CHECKING:
    from vtff_gnss.ephemeris import BroadcastEphemeris
    from vtff_iono.bias.code_biases import CodeBiasTable

_FORMS = ("csv", "parquet")


def tec(
    files: Annotated[
        list[pathlib.Path],
        typer.Argument(help="Observation files and bags, each processed by itself."),
    ],
    nav: Annotated[
        Optional[list[pathlib.Path]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(help="RINEX navigation file or log with ephemerides; may be repeated."),
    ] = None,
    biases: Annotated[
        str,
        typer.Option(
            help="Satellite biases: a Bias-SINEX or DCB file, 'broadcast' (group delays of the "
            "navigation message) or 'none' (simulated signals without biases)."
        ),
    ] = "broadcast",
    form: Annotated[str, typer.Option("--format", help="csv or parquet.")] = "csv",
    partial: Annotated[
        bool, typer.Option("--partial", help="Use a damaged RINEX file up to the damage.")
    ] = False,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Folder for tables and plots; default: tec_DATE_TIME."),
    ] = None,
) -> None:
    """Compute absolute slant and vertical TEC, ROTI and scintillation of recorded receivers.

    Files: RINEX 2, 3 or 4, Compact RINEX (Hatanaka), NovAtel logs, any of them compressed, and
    bags with /NAME/gnss/high_rate or /NAME/gnss/epoch. Receivers on the ground or in orbit; a
    receiver without a stated position is located from its codes. The receiver bias is estimated,
    with a sigma. A file that cannot be used is reported, the others are processed; the exit code
    is then 1. As many receivers as there are processors are processed at once.

    Examples
    --------
    vtff tec BELE.crx.gz --nav BRDC.rnx.gz --biases CAS.BIA.gz

    vtff tec day*.obs --nav brdc.rnx --format parquet --out tec_of_march
    """
    # Imported here, because numpy, numba and matplotlib take a while.
    from vtff_analysis.tec.batch import TecOptions, TecOutcome, find_tasks, run_tasks
    from vtff_analysis.tec.output import write_summary
    from vtff_bag.run.folder import RunFolderError, output_folder

    console = Console(highlight=False)
    if form not in _FORMS:
        raise exit_with_error(
            console, f"--format {form!r}: one of {', '.join(_FORMS)} expected", EXIT_USAGE
        )
    ephemerides = _read_ephemerides(console, nav or [])
    satellite_biases = _read_biases(console, biases)
    try:
        folder = output_folder(out, "tec")
    except RunFolderError as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    summaries: list[dict[str, Any]] = []
    failed = 0
    entries = find_tasks(files)
    tasks = [entry for entry in entries if not isinstance(entry, TecOutcome)]
    options = TecOptions(folder, form, ephemerides, satellite_biases, partial)
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
            else:
                _print_summary(console, outcome.summary)
                summaries.append(outcome.summary)
            bar.advance(progress)
    if summaries:
        write_summary(summaries, folder / "tec.json")
    console.print(f"{len(summaries)} receivers, {failed} failed; folder: {folder}", markup=False)
    if failed:
        raise typer.Exit(EXIT_FAILURE)


def _read_ephemerides(
    console: Console, paths: list[pathlib.Path]
) -> tuple[BroadcastEphemeris, ...]:
    from vtff_gnss.files.observation_files import ObservationFileError, open_ephemerides

    ephemerides: list[BroadcastEphemeris] = []
    for path in paths:
        try:
            ephemerides += open_ephemerides(path)
        except ObservationFileError as error:
            raise exit_with_error(console, error, EXIT_USAGE) from error
        except OSError as error:
            raise exit_with_error(console, describe_os_error(error, path), EXIT_USAGE) from error
    return tuple(ephemerides)


def _read_biases(console: Console, text: str) -> str | CodeBiasTable:
    from vtff_iono.bias.bias_files import read_code_biases
    from vtff_iono.bias.code_biases import BiasFileError

    if text in ("broadcast", "none"):
        return text
    try:
        return read_code_biases(text)
    except BiasFileError as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise exit_with_error(console, describe_os_error(error, text), EXIT_USAGE) from error


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
