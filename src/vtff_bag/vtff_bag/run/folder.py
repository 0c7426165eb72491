"""The folder that a run or a study writes into; it is made before the first process starts."""

from __future__ import annotations

import datetime
import itertools
import os
import pathlib

_made_parents: set[pathlib.Path] = set()
"""Folders that this process made to hold a new folder: a refused command leaves none of them."""


class RunFolderError(ValueError):
    """A folder cannot be used; the text names the folder and the reason."""


def dated_name(name: str) -> str:
    """Return a name with the local date and time appended."""
    return f"{name}_{datetime.datetime.now():%Y%m%d_%H%M%S}"


def new_folder(folder: pathlib.Path) -> pathlib.Path:
    """Make a new folder; if it exists, append ``_2``, ``_3``, ... to its name.

    Raises
    ------
    RunFolderError
        If the folder cannot be made.
    """
    for number in itertools.count(1):
        candidate = folder if number == 1 else folder.with_name(f"{folder.name}_{number}")
        parent = folder.parent.absolute()
        is_new = not parent.is_dir()
        try:
            candidate.mkdir(parents=True)
        except FileExistsError:
            if folder.parent.is_dir():
                continue
            raise RunFolderError(f"{folder.parent} is not a folder") from None
        except OSError as error:
            raise RunFolderError(f"cannot make the folder {folder}: {error.strerror}") from error
        if is_new:
            _made_parents.add(parent.resolve())
        return candidate.resolve()
    raise AssertionError("unreachable: the count does not end")


def chosen_folder(folder: pathlib.Path, *, empty: bool) -> pathlib.Path:
    """Return the folder that a user asked for; make it if it does not exist.

    Parameters
    ----------
    folder
        The folder, as the user gave it.
    empty
        Whether the folder must be empty.

    Raises
    ------
    RunFolderError
        If the folder cannot be made or written, is a file, is not empty, or has a name that is not
        UTF-8.
    """
    _check_name(folder)
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


def chosen_file(file: pathlib.Path, suffix: str) -> pathlib.Path:
    """Return the file that a user asked for, before anything is computed for it.

    A file of the same kind is written anew; any other that exists is somebody's.

    Parameters
    ----------
    file
        The file, as the user gave it.
    suffix
        End of the names of such files, as ``".html"``.

    Raises
    ------
    RunFolderError
        If its folder does not exist or cannot be written, or if the file exists and is another
        thing than a regular file with this suffix.
    """
    _check_name(file)
    try:
        if not file.parent.is_dir():
            raise RunFolderError(f"{file}: there is no folder {file.parent}")
        exists = file.exists() or file.is_symlink()
        if exists and not (file.is_file() and file.suffix.lower() == suffix):
            raise RunFolderError(f"{file} exists and is no {suffix} file; choose another name")
    except OSError as error:
        raise RunFolderError(f"cannot write {file}: {error.strerror}") from error
    if not os.access(file if exists else file.parent, os.W_OK):
        raise RunFolderError(f"cannot write {file}: permission denied")
    return file


def _check_name(path: pathlib.Path) -> None:
    try:
        os.fspath(path).encode("utf-8")
    except UnicodeEncodeError:
        raise RunFolderError(f"{os.fsencode(path)!r}: a name in UTF-8 expected") from None


def output_folder(
    out: pathlib.Path | None, name: str, *, parent: str = ".", empty: bool = False
) -> pathlib.Path:
    """Return the folder that a command writes into: the given folder, or a new dated folder.

    Parameters
    ----------
    out
        The folder given on the command line; None for a new folder.
    name, parent
        Name of the new folder, see `dated_name`, and the folder in which it is made.
    empty
        Whether a given folder must be empty.

    Raises
    ------
    RunFolderError
        See `new_folder` and `chosen_folder`.
    """
    if out is None:
        return new_folder(pathlib.Path(parent) / dated_name(name))
    return chosen_folder(out, empty=empty)


def remove_if_empty(folder: pathlib.Path) -> None:
    """Remove the folder of a run that did not start, if it is empty.

    The folder that was made to hold it goes too.
    """
    if not any(folder.iterdir()):
        folder.rmdir()
        if folder.parent in _made_parents and not any(folder.parent.iterdir()):
            folder.parent.rmdir()
            _made_parents.discard(folder.parent)
