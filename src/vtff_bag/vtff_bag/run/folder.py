"""The folder that a run or a study writes into: made for it alone, before anything starts."""

from __future__ import annotations

import datetime
import itertools
import os
import pathlib


class RunFolderError(ValueError):
    """A folder cannot be used; the text names it and says why."""


def dated_name(name: str) -> str:
    """Return a name with the local date and time behind it."""
    return f"{name}_{datetime.datetime.now():%Y%m%d_%H%M%S}"


def new_folder(folder: pathlib.Path) -> pathlib.Path:
    """Make a folder that did not exist: this one, or with ``_2``, ``_3``, ... behind its name.

    Raises
    ------
    RunFolderError
        If it cannot be made.
    """
    for number in itertools.count(1):
        candidate = folder if number == 1 else folder.with_name(f"{folder.name}_{number}")
        try:
            candidate.mkdir(parents=True)
        except FileExistsError:
            if folder.parent.is_dir():
                continue
            raise RunFolderError(f"{folder.parent} is not a folder") from None
        except OSError as error:
            raise RunFolderError(f"cannot make the folder {folder}: {error.strerror}") from error
        return candidate.resolve()
    raise AssertionError("unreachable: the count does not end")


def chosen_folder(folder: pathlib.Path, *, empty: bool) -> pathlib.Path:
    """Return the folder that a user asked for, made if it did not exist.

    Parameters
    ----------
    folder
        As given.
    empty
        Whether it must not hold anything.

    Raises
    ------
    RunFolderError
        If it cannot be made or written, is a file, or is not empty.
    """
    try:
        folder = folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        filled = any(folder.iterdir())
    except (FileExistsError, NotADirectoryError):
        raise RunFolderError(f"{folder} is not a folder; choose another --out") from None
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle, on Python < 3.13
        reason = error.strerror if isinstance(error, OSError) else error
        raise RunFolderError(f"cannot make the folder {folder}: {reason}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise RunFolderError(f"cannot write into {folder}: permission denied")
    if empty and (folder / "bag").exists():
        raise RunFolderError(f"{folder} already holds a run; choose another --out")
    if empty and filled:
        raise RunFolderError(f"{folder} is not empty; choose another --out")
    return folder


def output_folder(
    out: pathlib.Path | None, name: str, *, parent: str = ".", empty: bool = False
) -> pathlib.Path:
    """Return the folder that a command writes into: the one asked for, or a new dated one.

    Parameters
    ----------
    out
        As given on the command line; None for a new folder.
    name, parent
        Of the new folder, see `dated_name`.
    empty
        Whether a folder that was asked for must not hold anything.

    Raises
    ------
    RunFolderError
        See `new_folder` and `chosen_folder`.
    """
    if out is None:
        return new_folder(pathlib.Path(parent) / dated_name(name))
    return chosen_folder(out, empty=empty)


def remove_if_empty(folder: pathlib.Path) -> None:
    """Take away a folder that was made for a run that did not start."""
    if not any(folder.iterdir()):
        folder.rmdir()
