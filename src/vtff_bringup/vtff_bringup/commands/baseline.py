"""`vtff baseline`: the position of one recorded receiver relative to another."""

from __future__ import annotations

import pathlib
from typing import TYPE_CHECKING, Annotated, Literal, Optional

import typer
from rich.console import Console
from rich.table import Column, Table

from vtff_bringup.commands.command_line import TableForm, command_line, folder_option
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import describe_os_error, exit_with_error, print_note
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE

if TYPE_CHECKING:
    from rich.progress import Progress

    from vtff_analysis.baseline.processing import BaselineOptions
    from vtff_analysis.baseline.sources import BaselineSources
    from vtff_dynamics.time.timescales import GpsTime

Estimator = Literal["cdgps", "paper"]
Dynamics = Literal["static", "kinematic", "orbital"]

_REASONS_SHOWN = 4


def baseline(
    rover: Annotated[
        pathlib.Path,
        typer.Argument(help="Observations of the rover (deputy), or a bag with both receivers."),
    ],
    base: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Argument(help="Observations of the base (chief); not with a bag."),
    ] = None,
    navigation: Annotated[
        Optional[list[pathlib.Path]],  # noqa: UP045
        typer.Argument(
            metavar="NAV",
            help="RINEX navigation or SP3 files; not needed if the logs hold ephemerides.",
        ),
    ] = None,
    dynamics: Annotated[
        Optional[Dynamics],  # noqa: UP045
        typer.Option(
            help="static, kinematic (the rover moves, on or near the ground) or orbital (both in "
            "orbit); default: kinematic or orbital, by the height of the base.",
        ),
    ] = None,
    estimator: Annotated[
        Estimator, typer.Option(help="paper: orbital only, phase of one signal.")
    ] = "cdgps",
    signals: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            help="System letters and RINEX frequency digits, as G1,G2,E1,E5; default: "
            "G1,G2,G5,E1,E5,E7, and G1 for the paper's filter."
        ),
    ] = None,
    elevation_mask: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(help="Degrees; default: 5 in orbit, 10 on the ground.", min=-90.0, max=90.0),
    ] = None,
    base_position: Annotated[
        Optional[tuple[float, float, float]],  # noqa: UP045
        typer.Option(
            metavar="X Y Z",
            help="Antenna of the base, ITRF, m; default: that of the RINEX header, else estimated.",
        ),
    ] = None,
    estimate_base: Annotated[
        bool, typer.Option("--estimate-base", help="Do not use the position in the header.")
    ] = False,
    code_sigma: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            help="Code noise of a receiver with multipath, m; default: 1 on the ground, in orbit "
            "what the receiver states or 0.3.",
            min=1e-3,
        ),
    ] = None,
    phase_sigma: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            help="Phase noise likewise, m; default: 0.003 on the ground, in orbit what the "
            "receiver states or 0.001.",
            min=1e-5,
        ),
    ] = None,
    troposphere: Annotated[
        Optional[bool],  # noqa: UP045
        typer.Option("--troposphere/--no-troposphere", help="Model it; default: unless in orbit."),
    ] = None,
    start: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(help="First epoch: 2023-01-08T10:05:00, or s after the first common one."),
    ] = None,
    end: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(help="Last epoch, likewise; GPS time unless UTC is put behind it."),
    ] = None,
    truth: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(
            help="True positions: Parquet or CSV of this command, CSV of SimGEN, or npz (t, A, B); "
            "a bag of a simulation has its own."
        ),
    ] = None,
    partial: Annotated[
        bool, typer.Option("--partial", help="Use a damaged RINEX file up to the damage.")
    ] = False,
    rover_name: Annotated[str, typer.Option(help="Receiver in a bag.")] = "deputy",
    base_name: Annotated[str, typer.Option(help="Receiver in a bag.")] = "chief",
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for table, JSON and plot; default: baseline_DATE_TIME."),
    ] = None,
    form: TableForm = "parquet",
) -> None:
    """Compute the position of one receiver relative to another.

    Recorded observations are used. Files: RINEX 2, 3 or 4, Compact RINEX (Hatanaka), NovAtel logs,
    any of them compressed; the format is found by content; orbits also from SP3 files. Epochs
    whose time tags differ by less than 20 ms belong together. The filter is that of the loop, in
    the order of time.

    Prints how many epochs were fixed, the baseline with its scatter and sigma (east, north, up of
    the base, or radial, in-track, cross-track) and writes a table of the epochs, JSON, a plot and
    a page.

    For example:

    vtff baseline rover.crx.gz base.crx.gz brdc.rnx.gz --dynamics static

    vtff baseline deputy.obs chief.obs brdc.rnx --truth truth.npz

    vtff baseline rover.dat base.dat --dynamics static

    vtff baseline bags/mine
    """
    # Imported here, because numpy, brahe and matplotlib take a while.
    from rich.progress import Progress

    from vtff_analysis.baseline.defaults import complete_options
    from vtff_analysis.baseline.sources import BaselineError
    from vtff_bag.file.errors import BagError
    from vtff_bag.run.folder import RunFolderError
    from vtff_gnss.files.observation_files import ObservationFileError

    console = make_console()
    try:
        bands = _parse_bands(signals, estimator)
        with Progress(console=console, transient=True, disable=not console.is_interactive) as bar:
            names = (rover_name, base_name)
            sources = _read_sources(rover, base, navigation or [], bands, partial, names, bar)
        options = complete_options(
            sources, dynamics, estimator, bands, elevation_mask, base_position, estimate_base,
            (code_sigma, phase_sigma), troposphere,
            _parse_limit(start, sources, "--start"), _parse_limit(end, sources, "--end"),
        )  # fmt: skip
        raise typer.Exit(_compute(console, sources, options, truth, out, form))
    except (BaselineError, ObservationFileError, BagError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise exit_with_error(console, describe_os_error(error), EXIT_USAGE) from error


def _parse_bands(signals: str | None, estimator: str) -> dict[int, tuple[int, ...]]:
    from vtff_analysis.baseline.sources import BaselineError
    from vtff_nav.relative.common.measurements import DEFAULT_BANDS
    from vtff_nav.relative.common.signal_bands import parse_bands
    from vtff_nav.relative.paper.estimator import PaperConfiguration

    if signals is None:
        return dict(PaperConfiguration().bands if estimator == "paper" else DEFAULT_BANDS)
    try:
        return parse_bands([name.strip() for name in signals.split(",") if name.strip()])
    except ValueError as error:
        raise BaselineError(f"--signals {signals!r}: {error}") from None


def _read_sources(
    rover: pathlib.Path,
    base: pathlib.Path | None,
    navigation: list[pathlib.Path],
    bands: dict[int, tuple[int, ...]],
    partial: bool,
    names: tuple[str, str],
    bar: Progress,
) -> BaselineSources:
    from vtff_analysis.baseline.bag_sources import from_bag
    from vtff_analysis.baseline.sources import BaselineError, from_files
    from vtff_bag.file.reader import BagReader

    task = bar.add_task("reading", total=None)
    is_bag = rover.is_dir() or rover.suffix == ".mcap"
    if is_bag and base is not None:
        BagReader(rover)  # a folder without a bag is refused as such
        raise BaselineError(
            f"{rover} is a bag, which holds both receivers (--rover-name, --base-name): leave "
            f"{base} out"
        )
    if is_bag:
        return from_bag(rover, *names)
    if base is None and not rover.exists():
        raise BaselineError(f"{rover}: no such file or bag")
    if base is None:
        raise BaselineError(f"{rover} is no bag: name the observations of the base too")
    return from_files(
        rover, base, navigation, bands, partial,
        lambda name: bar.update(task, description=f"reading {name}"),
    )  # fmt: skip


def _parse_limit(text: str | None, sources: BaselineSources, option: str) -> GpsTime | None:
    """Return a time given as an epoch or as seconds after the first common epoch."""
    from vtff_analysis.baseline.sources import BaselineError
    from vtff_dynamics.time.timescales import TIME_SCALES, parse_epoch

    if text is None:
        return None
    try:
        return sources.rover.time(sources.common_epochs()[0][0]) + float(text)
    except BaselineError:
        raise
    except ValueError:
        pass
    has_scale = text.rstrip().endswith((*TIME_SCALES, "Z"))
    try:
        return parse_epoch(text if has_scale else f"{text} GPS")
    except ValueError as error:
        raise BaselineError(f"{option}: {error}, or seconds") from None


def _compute(
    console: Console,
    sources: BaselineSources,
    options: BaselineOptions,
    truth: pathlib.Path | None,
    out: pathlib.Path | None,
    form: str,
) -> int:
    """Run the filter, write the files and print the summary; return the exit code."""
    from rich.progress import Progress

    from vtff_analysis.baseline.output import write_epochs, write_json, write_plot
    from vtff_analysis.baseline.processing import process_baseline
    from vtff_analysis.baseline.summary import summarise
    from vtff_analysis.baseline.tables import component_rows, lead_sentence, summary_rows
    from vtff_analysis.baseline.truth import errors_local
    from vtff_analysis.page.results import Section, write_results
    from vtff_bag.run.folder import output_folder

    for remark in sources.remarks:
        print_note(console, remark)
    with Progress(console=console, transient=True, disable=not console.is_interactive) as bar:
        task = bar.add_task(f"{options.estimator}, {options.dynamics}", total=None)
        run = process_baseline(
            sources, options, lambda done, total: bar.update(task, completed=done, total=total)
        )
    reference = truth or sources.truth
    errors = errors_local(run, reference) if reference is not None else None
    summary = summarise(run, errors)
    folder = output_folder(out, "baseline")
    title = f"{sources.rover_name} relative to {sources.base_name}"
    sentence = lead_sentence(run, summary)
    facts = summary_rows(run, summary)
    heads, components = component_rows(options, run, summary)
    caption = "Components with three sigma, kind of solution and satellites."
    used = [("used", line) for line in sources.usage]
    command = command_line(without="--out")
    try:
        epochs = write_epochs(run, errors, folder, form, title)
        write_json(summary, folder / "baseline.json")
        plot = write_plot(run, errors, folder / "baseline.png", title)
        sections = (
            Section("", heads, components, [(plot, caption)], sources.remarks),
            Section("Epochs and solutions", ("", ""), [*facts, *used], numbers=False),
        )
        write_results(folder / "baseline.html", title, sections, command=command, lead=sentence)
    except OSError as error:
        raise exit_with_error(console, describe_os_error(error, folder), EXIT_FAILURE) from error
    console.print(title, markup=False, style="bold", soft_wrap=True)
    for line in (sentence, *sources.usage, *(f"{name:<12} {text}" for name, text in facts)):
        console.print(f"  {line}", markup=False, soft_wrap=True)
    table = Table(heads[0], *(Column(name, justify="right") for name in heads[1:]))
    for row in components:
        table.add_row(*row)
    console.print(table)
    for reason, count in sorted(run.degraded.items(), key=lambda item: -item[1])[:_REASONS_SHOWN]:
        console.print(f"  {count} epochs: {reason}", markup=False, soft_wrap=True)
    console.print(f"{epochs.name}, JSON, plot and page: {folder}", markup=False, soft_wrap=True)
    if summary.mean is None:
        console.print("[red]error:[/red] no epoch has a solution")
        return EXIT_FAILURE
    return 0
