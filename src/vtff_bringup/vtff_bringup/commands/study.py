"""`vtff study`: parameter studies."""

from __future__ import annotations

import itertools
import operator
import os
import pathlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from rich.console import Console
from rich.table import Table

from vtff_bag.file.errors import BagError
from vtff_bag.run.folder import RunFolderError, chosen_folder, output_folder, remove_if_empty
from vtff_bringup.commands.campaign import conclude_campaign, fly_campaign_visibly, stop
from vtff_bringup.commands.command_line import command_line, folder_option
from vtff_bringup.run.console import make_console
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE
from vtff_node.executables import ExecutableNotFoundError, share_file

if TYPE_CHECKING:
    from vtff_analysis.page.results import Section
    from vtff_analysis.paper_comparison import PaperComparison
    from vtff_analysis.studies.radial_offset import OffsetResult
    from vtff_analysis.studies.thrust_cap import ThrustCapFindings
    from vtff_bringup.campaign.campaign import CampaignResult

_LARGEST_OFFSET = 50e3  # m; farther down the deputy would be in the dense atmosphere

#: Captions of pictures that repeat no figure of a paper, by the names of their files.
_CAPTIONS = {
    "decay": "Distance of the other chaser from the lead when one fails and decays.",
    "paths": "Paths of the chasers about the lead, which is blue.",
    "sides": "Distances of all pairs: the sides of the triangle that the potential wants.",
}

app = typer.Typer(help="Parameter studies, beside the paper's.", no_args_is_help=True)


@app.callback()
def studies() -> None:
    """Parameter studies, beside the paper's."""


@app.command("thrust_cap")
def thrust_cap(
    scenario: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(help="Scenario file; default: the reference formation."),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for plot and CSV; default: studies/thrust_cap_DATE_TIME."),
    ] = None,
) -> None:
    """Fly the reference formation with many thrust caps.

    Caps from 0.01 to 10 m/s2 (paper 000, figure A2). The caps are those of the campaign
    config/campaign/thrust_cap.yaml.
    """
    # Imported here, because numpy and matplotlib take a while.
    from vtff_analysis.studies.thrust_cap import (
        find_landmarks,
        thrust_cap_point,
        write_csv,
        write_plot,
    )

    console = make_console()
    fixed = {} if scenario is None else {"scenario": str(scenario.resolve())}
    try:
        folder = output_folder(out, "thrust_cap", parent="studies")
    except RunFolderError as error:
        stop(console, error, EXIT_USAGE)
    result = _fly(console, "thrust_cap", {"fixed": fixed}, folder, f"--out {folder}")
    points = [
        thrust_cap_point(record["inputs"]["thrust_cap"], record["figures"])
        for record in result.records
    ]
    try:
        write_csv(points, folder / "thrust_cap.csv")
        write_plot(points, folder / "thrust_cap.png")
        landmarks = find_landmarks(points)
    except (OSError, ValueError) as error:
        stop(console, error, EXIT_FAILURE)
    table = _findings_table(landmarks)
    _print_result(console, landmarks.describe(), table)
    picture = (folder / "thrust_cap.png", "Velocity change and smallest in-track distance by cap.")
    sections = [_section(table, [picture])]
    try:
        page = _write_page(folder, "thrust_cap", "000", landmarks.describe(), sections)
    except OSError as error:
        stop(console, error, EXIT_FAILURE)
    console.print(f"{len(points)} caps; plot and table: {page}", markup=False, soft_wrap=True)


@app.command("radial_offset")
def radial_offset(
    model: Annotated[
        bool, typer.Option("--model", help="Only the paper's 75 dB model, no flights (seconds).")
    ] = False,
    offset: Annotated[
        Optional[list[float]],  # noqa: UP045
        typer.Option(
            metavar="METRES",
            help="Radial offset in m; may be repeated. Default: 100, 1000, 3000, 10000.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of every random stream.", min=0)] = 1,
    runs: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder of the flights; finished ones there are not flown again."),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for plots, CSV and flights; default: studies/radial_offset_..."),
    ] = None,
) -> None:
    """Retrieve density with radial offsets of 0.1 to 10 km.

    The density is the PLUMEX-like one (paper 000, section 4.4). Each offset is flown for an hour,
    receivers and navigation in the loop, as vtff run plumex does; the deputy starts on its offset:
    the campaign config/campaign/radial_offset.yaml. A flight takes some minutes of a core. Beside
    it stands the paper's simplified model: 75 dB of noise on the vertical TEC.

    Exit code: 0 complete, 1 a flight failed, 2 a file or an option is wrong, 130 interrupted by
    Ctrl-C: complete flights are kept, --runs goes on from there.
    """
    from vtff_analysis.studies.radial_offset import OFFSETS, OffsetError, flown_offset, run_offsets
    from vtff_bringup.campaign.worker import COMPLETE
    from vtff_sim_bridge.atmosphere.electron_density import ProfileError, read_profile

    console = make_console()
    offsets = sorted(set(offset or OFFSETS))
    try:
        if offsets[0] <= 0.0 or offsets[-1] > _LARGEST_OFFSET:
            raise OffsetError(f"--offset: more than 0 and at most {_LARGEST_OFFSET:g} m expected")
        profile = read_profile(share_file("vtff_bringup", "config/ionosphere/plumex.csv"))
        folder = output_folder(out, "radial_offset", parent="studies")
        flights = None if model else chosen_folder(runs or folder / "runs", empty=False)
    except (ProfileError, OSError, ValueError, ExecutableNotFoundError) as error:
        stop(console, error, EXIT_USAGE)
    flown: list[tuple[float, pathlib.Path]] = []
    if flights is not None:
        result = _fly_offsets(console, flights, offsets, seed)
        flown = [
            (-record["inputs"]["radial_position"], flights / record["run_folder"])
            for record in result.records
            if record["status"] == COMPLETE
        ]
    from rich.progress import Progress

    total = len(offsets) + len(flown)
    with Progress(console=console, transient=True, disable=not console.is_interactive) as bar:
        task = bar.add_task("retrieving", total=total)

        def tell(done: int, _: object) -> None:
            bar.update(task, completed=done)
            if not console.is_interactive:
                console.print(f"retrieved {done} of {total} offsets")

        try:
            results = run_offsets(profile, offsets, tell, seed)
            for flown_at, run in flown:
                results.append(flown_offset(run, flown_at))
                bar.advance(task)
        except (OffsetError, BagError, OSError) as error:
            stop(console, error, EXIT_FAILURE)
    _write_offsets(console, results, folder)


@app.command("formation_designs")
def formation_designs(
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for the CSV files; default: none are written."),
    ] = None,
) -> None:
    """Let formations drift for 15 orbits under J2.

    Shown are errors of models, and passive safety (paper 002). The first table is the error of
    mean relative elements with the J2 transition against the nonlinear motion; the second the
    closest approaches of paper 002's projected circular orbit, of its equation (7) taken
    literally, and of a helix of the same size. It takes some seconds.

    Exit code: 0 complete, 2 the folder cannot be used.
    """
    from vtff_analysis.studies.formation_designs import (
        describe_designs,
        fflas_formations,
        fly_formation,
        model_errors,
        write_formation_designs,
    )

    console = make_console()
    try:
        folder = None if out is None else chosen_folder(out, empty=False)
    except RunFolderError as error:
        stop(console, error, EXIT_USAGE)
    console.print("drifting for 15 orbits: designs, then the formations of paper 002 ...")
    errors = model_errors()
    table = Table("design", "size", "e", "largest error", "of the size", title="Model, 15 orbits")
    for row in errors:
        table.add_row(
            row.design,
            f"{row.size:g} m",
            f"{row.eccentricity:g}",
            f"{row.error:.3f} m",
            f"{row.percent:.3f} %",
        )
    sections = [_section(table)]
    designs = table
    pairs = [
        (elements, pair)
        for name, relative in fflas_formations().items()
        for elements in ("osculating", "mean")
        for pair in fly_formation(name, relative, elements)
    ]
    table = Table(
        "formation", "set up in", "pair", "closest", "farthest", "closest in R-N", title="Paper 002"
    )
    for elements, pair in pairs:
        table.add_row(
            pair.formation,
            elements,
            f"{pair.first}-{pair.second}",
            f"{pair.closest:.2f} m",
            f"{pair.farthest:.2f} m",
            f"{pair.closest_radial_normal:.2f} m",
        )
    sentence = describe_designs(errors, [pair for _, pair in pairs])
    _print_result(console, sentence, designs, table)
    remark = (
        "pco_literal has the in-track offset of the paper's equation (7): with it B and C meet. "
        "A projected circle is not passively safe (R-N separation 0), a helix is."
    )
    console.print(remark)
    sections.append(_section(table, points=(remark,)))
    if folder is not None:
        try:
            page = _write_page(folder, "formation_designs", "002", sentence, sections)
            written = (*write_formation_designs(folder, errors, pairs), page)
        except OSError as error:
            stop(console, error, EXIT_FAILURE)
        for path in written:
            console.print(f"wrote {path}")


@app.command("snap1")
def snap1(
    hours: Annotated[
        float, typer.Option(help="Length of the three-axis flights in h; the paper's: 28.", min=4.0)
    ] = 28.0,
    seed: Annotated[int, typer.Option(help="Seed of every random stream.", min=0)] = 1,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for table and figures; default: studies/snap1_DATE_TIME."),
    ] = None,
) -> None:
    """Fly the attitude of SNAP-1 (paper 003).

    Tables 2 and 5 and figures 2 to 11, paper beside measured. Truth, emulated ADCS module,
    estimator and controller in one loop without ROS. Written are snap1.csv and one picture for
    each figure. What the paper does not give is assumed, and said.
    """
    from vtff_analysis.attitude.orbit_raising import RAISING_ASSUMPTIONS
    from vtff_analysis.attitude.raising_orbits import FIX_ASSUMPTIONS
    from vtff_analysis.attitude.snap1 import ASSUMPTIONS
    from vtff_analysis.attitude.snap1_output import run_snap1

    _compare_with_paper(
        "snap1",
        "003",
        out,
        lambda folder, say: run_snap1(folder, hours, seed, say),
        "assumed",
        (*ASSUMPTIONS, *RAISING_ASSUMPTIONS, *FIX_ASSUMPTIONS),
    )


@app.command("fflas")
def fflas(
    days: Annotated[
        float, typer.Option(help="Length of the keeping in days; the paper's: 1.", min=0.1)
    ] = 1.0,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for table and figures; default: studies/fflas_DATE_TIME."),
    ] = None,
) -> None:
    """Plan and fly the FFLAS extension (paper 002).

    Tables 3 and 5, figures 4 to 6 and 9 to 15. Phasing, reconfiguration by convex optimisation
    flown again in nonlinear motion, keeping by pulses of the T5 engine on 8x8 truth, disposal.
    Written are fflas.csv and one picture for each figure. It takes about a minute for each day.
    """
    from vtff_analysis.fflas.output import FAULTS, run_fflas

    _compare_with_paper(
        "fflas",
        "002",
        out,
        lambda folder, say: run_fflas(folder, days, say),
        "faults of the paper",
        FAULTS,
    )


@app.command("potential_field")
def potential_field(
    starts: Annotated[int, typer.Option(help="Drawn starts of two chasers.", min=1)] = 30,
    seed: Annotated[int, typer.Option(help="Seed of the first start.", min=0)] = 0,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder for table and figures; default: studies/potential_field_..."),
    ] = None,
) -> None:
    """Fly clusters by potential fields (paper 001).

    The published program stands beside a corrected one. Every chaser decides alone, from its own
    position and a sensor of range and direction with noise, a range limit and dropouts; the truth
    is nonlinear with J2. Starts, one to five chasers, a blind sensor, a neighbour that decays. It
    takes about three seconds for each start.
    """
    from vtff_analysis.cluster.literal import FAULTS
    from vtff_analysis.cluster.output import run_potential_field

    _compare_with_paper(
        "potential_field",
        "001",
        out,
        lambda folder, say: run_potential_field(folder, starts, seed, say),
        "faults of the paper",
        FAULTS,
    )


def _compare_with_paper(
    name: str,
    paper: str,
    out: pathlib.Path | None,
    run: Callable[[pathlib.Path, Callable[[str], None]], PaperComparison],
    remark: str,
    points: Sequence[str],
) -> None:
    """Run a study in its folder; print its rows, paper beside measured, and write its page.

    `run` gets the folder and the function that prints a line of progress; `points` are what
    `remark` calls them.
    """
    from vtff_analysis.page.results import Section

    console = make_console()
    try:
        folder = output_folder(out, name, parent="studies")
        found = run(folder, lambda line: console.print(line, markup=False))
        texts = [(row.subject, row.quantity, row.paper, row.measured) for row in found.rows]
        pictures = [(path, _caption(path, paper)) for path in _in_order(folder.glob("*.png"))]
        rows: list[Sequence[str]] = []
        for subject, group in itertools.groupby(texts, operator.itemgetter(0)):
            rows += [subject, *(row[1:] for row in group)]
        results = Section("", ("", "paper", "measured"), rows, pictures, numbers=False)
        open_points = Section(f"{remark[0].upper()}{remark[1:]}", (), (), points=points)
        page = _write_page(folder, name, paper, found.sentence, [results, open_points])
    except RunFolderError as error:
        stop(console, error, EXIT_USAGE)
    except OSError as error:
        stop(console, error, EXIT_FAILURE)
    table = Table("", "", "paper", "measured")
    for row in texts:
        table.add_row(*row)
    _print_result(console, found.sentence, table)
    console.print(f"{remark}: {'; '.join(points)}", markup=False)
    console.print(f"table and figures: {page}", markup=False, soft_wrap=True)


def _print_result(console: Console, sentence: str, *tables: Table) -> None:
    """Print the result in plain words, and the tables behind it."""
    console.print(sentence, markup=False)
    for table in tables:
        console.print(table)


def _in_order(paths: Iterable[pathlib.Path]) -> list[pathlib.Path]:
    """Return figures by their numbers, figure 4 before figure 10, then the other pictures."""

    def place(path: pathlib.Path) -> tuple[bool, int, str]:
        number = path.stem.removeprefix("figure_")
        return not number.isdecimal(), int(number) if number.isdecimal() else 0, path.stem

    return sorted(paths, key=place)


def _caption(path: pathlib.Path, paper: str) -> str:
    """Return the caption of a picture: what it shows, and which figure of the paper it repeats."""
    from vtff_analysis.plot_style import figure_title

    stem = path.stem
    kind, _, number = stem.partition("_")
    if kind != "figure" or not number:
        return _CAPTIONS.get(stem, f"{stem.replace('_', ' ').capitalize()}.")
    shown = figure_title(path).partition(": ")[2]
    told = f": {shown}" if shown else ""
    return f"Figure {number.replace('_', ' ')} of paper {paper}, as computed here{told}."


def _section(
    table: Table, pictures: Sequence[tuple[pathlib.Path, str]] = (), points: Sequence[str] = ()
) -> Section:
    """Return a table of the console as a section of a page."""
    from vtff_analysis.page.results import Section

    heads = [str(column.header) for column in table.columns]
    rows = list(zip(*(map(str, column.cells) for column in table.columns), strict=True))
    title = "" if table.title is None else str(table.title)
    return Section(title, heads, rows, pictures, numbers=False, points=points)


def _write_page(
    folder: pathlib.Path, name: str, paper: str, sentence: str, sections: Sequence[Section]
) -> pathlib.Path:
    """Write the page of a study, which a sentence opens; return its file."""
    from vtff_analysis.page.results import write_results

    page = folder / f"{name}.html"
    command = command_line(without="--out")
    write_results(page, f"vtff study {name}", sections, (paper,), command, sentence)
    return page


def _fly_offsets(
    console: Console, flights: pathlib.Path, offsets: Sequence[float], seed: int
) -> CampaignResult:
    """Fly the offsets that are not finished in the folder of the flights."""
    from vtff_bringup.campaign.campaign_file import (
        CampaignError,
        find_campaign_file,
        load_campaign,
    )

    try:
        (variable,) = load_campaign(find_campaign_file("radial_offset")).variables
    except CampaignError as error:
        stop(console, error, EXIT_USAGE)
    entry = {
        "sets": list(variable.keys),
        "unit": variable.unit,
        "values": [-offset for offset in offsets],
    }
    chosen = {"seeds": [seed], "vary": {variable.name: entry}}
    return _fly(console, "radial_offset", chosen, flights, f"--runs {flights}")


def _fly(
    console: Console,
    name: str,
    overrides: Mapping[str, Any],
    folder: pathlib.Path,
    option: str,
) -> CampaignResult:
    """Fly the campaign of a study in a folder; ends the command where a case failed."""
    from vtff_bringup.campaign.campaign import Execution, prepare_campaign
    from vtff_bringup.campaign.campaign_file import (
        CampaignError,
        find_campaign_file,
        load_campaign,
    )

    try:
        campaign = load_campaign(find_campaign_file(name), overrides)
        prepared = prepare_campaign(campaign, folder, "bags")
    except CampaignError as error:
        remove_if_empty(folder)
        stop(console, error, EXIT_USAGE)
    execution = Execution(os.cpu_count() or 1, resume=True)
    again = f"vtff study {name} {option}"
    result = fly_campaign_visibly(console, prepared, execution, again)
    if not result.holds:
        conclude_campaign(console, prepared, result)
        raise typer.Exit(EXIT_FAILURE)
    return result


def _write_offsets(console: Console, results: Sequence[OffsetResult], folder: pathlib.Path) -> None:
    """Write table and figures, those of the model and of the flights each by themselves."""
    from vtff_analysis.studies.radial_offset_output import (
        describe_results,
        results_table,
        write_csv,
        write_profiles_plot,
        write_spectra_plot,
    )

    try:
        write_csv(results, folder / "radial_offset.csv")
        for source in sorted({result.source for result in results}):
            mine = [result for result in results if result.source == source]
            write_profiles_plot(mine, folder / f"profiles_{source}.png")
            write_spectra_plot(mine, folder / f"spectra_{source}.png")
    except OSError as error:
        stop(console, error, EXIT_FAILURE)
    table = results_table(results)
    sentence = describe_results(results)
    _print_result(console, sentence, table)
    remark = (
        "mean error: of single samples, against the truth averaged over the separation. departs: "
        "squared spectrum ratio below -3.9 dB. resolved: neither averaged away nor in the noise."
    )
    console.print(remark)
    captions = {
        "profiles": "Density over altitude as retrieved, and the true one, for each offset",
        "spectra": "Spectra of the retrieved densities, and of the true one",
    }
    pictures = [
        (folder / f"{kind}_{source}.png", f"{caption} ({source}).")
        for source in sorted({result.source for result in results})
        for kind, caption in captions.items()
    ]
    section = _section(table, pictures, (remark,))
    try:
        page = _write_page(folder, "radial_offset", "000", sentence, [section])
    except OSError as error:
        stop(console, error, EXIT_FAILURE)
    console.print(f"plots and table: {page}", markup=False, soft_wrap=True)


def _findings_table(found: ThrustCapFindings) -> Table:
    table = Table(title="thrust cap, reference formation, 1 h", title_justify="left")
    table.add_column("")
    table.add_column("measured", justify="right")
    table.add_column("paper 000", justify="right")
    rows = [
        ("smallest cap that settles, m/s2", f"{found.smallest_settling_cap:.3f}", "0.02"),
        ("minimum in-track changes sign at, m/s2", f"{found.sign_change_cap:.2f}", "1.20"),
        ("least in-track dv of region 2 at, m/s2", f"{found.optimum_cap:.2f}", "1.4"),
        ("  that dv, m/s", f"{found.optimum_delta_v:.2f}", ""),
        ("largest minimum in-track, m", f"{found.largest_minimum_in_track:.2f}", "69.02"),
        ("  at, m/s2", f"{found.largest_minimum_cap:.2f}", "1.95"),
        ("in-track dv at the largest cap, m/s", f"{found.asymptotic_delta_v:.2f}", "constant"),
    ]
    for row in rows:
        table.add_row(*row)
    return table
