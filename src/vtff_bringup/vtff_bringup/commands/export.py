"""`vtff export`: a bag in the formats of other programs."""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import Annotated, Any, Optional

import typer

from vtff_bag.file.errors import BagError
from vtff_bag.run.folder import RunFolderError, chosen_folder
from vtff_bringup.commands.command_line import RecordedRun, folder_option
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error, print_note
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE


def export(
    bag: RecordedRun,
    parquet: Annotated[
        bool,
        typer.Option(
            "--parquet",
            help="Each topic as Parquet with units and times in its metadata, arrays as lists; the "
            "default if nothing is named.",
        ),
    ] = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="Each topic as CSV: one row a message, or a signal.")
    ] = False,
    rinex: Annotated[
        bool, typer.Option("--rinex", help="Observations and ephemerides as RINEX 3.05.")
    ] = False,
    high_rate: Annotated[
        bool, typer.Option("--high-rate", help="RINEX of gnss/high_rate instead of gnss/epoch.")
    ] = False,
    sp3: Annotated[bool, typer.Option("--sp3", help="Orbits as SP3-d (ITRF, GPS time).")] = False,
    oem: Annotated[
        bool, typer.Option("--oem", help="Orbits as CCSDS OEM 2.0 (GCRF, UTC).")
    ] = False,
    czml: Annotated[bool, typer.Option("--czml", help="Orbits as CZML for Cesium or STK.")] = False,
    interval: Annotated[
        Optional[float],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(help="Shortest time between orbit states to keep, s; default: all.", min=0.0),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder to write; default: RUN/export, or BAG_export beside a bag."),
    ] = None,
) -> None:
    """Write a bag in the formats of other programs.

    Parquet tables, or the formats that are named. Orbits are the truth where it is recorded, else
    the receivers' own solutions.

    For example:

    vtff export bags/mine

    vtff export bags/mine --rinex --oem
    """
    console = make_console()
    chosen = [
        name
        for name, wanted in (
            ("csv", csv),
            ("parquet", parquet),
            ("rinex", rinex),
            ("sp3", sp3),
            ("oem", oem),
            ("czml", czml),
        )
        if wanted
    ] or ["parquet"]
    # Imported here, because rclpy takes a while.
    from vtff_analysis.recordings.errors import RecordingError
    from vtff_analysis.recordings.run_place import find_run

    try:
        place = find_run(bag)
        folder = chosen_folder(out or place.output_folder("export"), empty=False)
        with console.status("exporting") as status:
            files, notes = _write_formats(
                place.bag, place.name, folder, chosen, interval, high_rate, status.update
            )
    except (BagError, RecordingError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise exit_with_error(console, error, EXIT_FAILURE) from error
    for path in files:
        console.print(str(path), markup=False, soft_wrap=True)
    for note in notes:
        print_note(console, note)


def _write_formats(
    bag: pathlib.Path,
    name: str,
    folder: pathlib.Path,
    chosen: list[str],
    interval: float | None,
    high_rate: bool,
    progress: Callable[[str], Any],
) -> tuple[list[pathlib.Path], list[str]]:
    """Write the chosen formats; return the files and notes for the user."""
    from vtff_analysis.export.czml import format_czml
    from vtff_analysis.export.oem import format_oem
    from vtff_analysis.export.rinex import export_rinex
    from vtff_analysis.export.sp3 import format_sp3
    from vtff_analysis.export.tables import export_csv, export_parquet
    from vtff_analysis.recordings.orbits import read_orbits
    from vtff_analysis.recordings.topics import key_part
    from vtff_bag.file.reader import BagReader

    reader = BagReader(bag)
    files: list[pathlib.Path] = []
    notes: list[str] = []
    for kind, write in (("csv", export_csv), ("parquet", export_parquet)):
        if kind in chosen:
            written, remarks = write(reader, folder, progress)
            files += written
            notes += remarks
    if "rinex" in chosen:
        progress("rinex")
        files += export_rinex(reader, folder, high_rate=high_rate)
    if {"sp3", "oem", "czml"} & set(chosen):
        progress("orbits")
        orbits = read_orbits(reader, interval)
        texts: dict[str, str] = {}
        if "sp3" in chosen:
            texts["orbits.sp3"] = format_sp3(orbits)
        if "oem" in chosen:
            texts |= {f"{key_part(orbit.name)}.oem": format_oem(orbit) for orbit in orbits}
        if "czml" in chosen:
            texts["orbits.czml"] = format_czml(orbits, name)
        for file_name, text in texts.items():
            (folder / file_name).write_text(text, encoding="utf-8", newline="\n")
            files.append(folder / file_name)
    return files, [*reader.notes, *notes]
