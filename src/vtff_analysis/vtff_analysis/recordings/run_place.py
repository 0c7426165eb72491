"""Place of a run on the disk: its name, its bag, its folder, and the folders of derived files."""

from __future__ import annotations

import dataclasses
import pathlib

from vtff_bag.file.reader import RUN_SUBDIRECTORY, BagReader
from vtff_bag.run.description import PARAMETER_FOLDER

__all__ = ["RunPlace", "find_run"]


@dataclasses.dataclass(frozen=True)
class RunPlace:
    """A run on the disk.

    Attributes
    ----------
    name
        Name of the run.
    bag
        The bag: directory or file.
    folder
        The run folder. A bag without a run folder stands for it: its directory, or the folder
        that its file lies in.
    has_run_folder
        Whether the bag lies in a run folder.
    """

    name: str
    bag: pathlib.Path
    folder: pathlib.Path
    has_run_folder: bool

    def output_folder(self, kind: str) -> pathlib.Path:
        """Return the default folder of a kind of output, such as ``report``.

        It is ``<kind>`` in the run folder, or ``<name>_<kind>`` beside a bag that has none.
        """
        if self.has_run_folder:
            return self.folder / kind
        return self.bag.parent / f"{self.name}_{kind}"


def find_run(path: pathlib.Path) -> RunPlace:
    """Find the run folder and the bag behind a path that a user has named.

    Parameters
    ----------
    path
        Run folder, bag directory or ``.mcap`` file.

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag.
    """
    bag = BagReader(path).path.resolve()
    folder = bag.parent
    has_run_folder = bag.name == RUN_SUBDIRECTORY and (
        path.resolve() == folder or (folder / PARAMETER_FOLDER).is_dir()
    )
    if has_run_folder:
        return RunPlace(folder.name, bag, folder, True)
    if bag.is_dir():
        return RunPlace(bag.name, bag, bag, False)
    return RunPlace(bag.stem, bag, folder, False)
