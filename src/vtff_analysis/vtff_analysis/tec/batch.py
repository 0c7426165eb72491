"""`vtff tec` on many receivers: as many at once as there are processors."""

from __future__ import annotations

import collections
import contextlib
import multiprocessing
import os
import pathlib
import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from vtff_analysis.recordings.run_place import find_run
from vtff_analysis.tec.bag_sources import bag_receivers, from_bag
from vtff_analysis.tec.errors import TecError
from vtff_analysis.tec.output import summarise_result, write_tables
from vtff_analysis.tec.processing import TecResult, process
from vtff_analysis.tec.receiver_orbit import ReceiverOrbit
from vtff_analysis.tec.sources import from_file, is_bag
from vtff_bag.file.errors import BagError
from vtff_gnss.files.navigation_files import NavigationFiles
from vtff_gnss.files.observation_files import ObservationFileError
from vtff_iono.bias.code_biases import BiasFileError, CodeBiasTable

__all__ = ["TecOptions", "TecOutcome", "TecTask", "find_tasks", "run_tasks"]


@dataclass(frozen=True)
class TecTask:
    """One receiver to be processed.

    Parameters
    ----------
    path : pathlib.Path
        File or bag.
    receiver : str or None
        Namespace in a bag; None for a file.
    name : str
        Unique name for the tables and plots of the task.
    """

    path: pathlib.Path
    receiver: str | None
    name: str


@dataclass(frozen=True, eq=False)
class TecOptions:
    """Options of all receivers; see `vtff_analysis.tec.processing.process`.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of tables and plots.
    form : str
        Format of the tables: ``parquet`` or ``csv``.
    navigation : NavigationFiles
        Orbits in addition to those of the files.
    biases : str or CodeBiasTable
        Satellite biases.
    partial : bool
        Whether a damaged file is used up to the damage.
    orbit : ReceiverOrbit or None
        Orbit of the receiver.
    allow_old_biases : bool
        Whether biases of another time are used.
    draw : callable, optional
        Function that draws the plots of a result into a folder under a name
        (`vtff_analysis.tec.plots.write_plots`); without it none are drawn.
    systems : str or None
        RINEX letters of the systems that are used; None for all.
    """

    folder: pathlib.Path
    form: str
    navigation: NavigationFiles = NavigationFiles()  # noqa: RUF009 - it does not change
    biases: str | CodeBiasTable = "broadcast"
    partial: bool = False
    orbit: ReceiverOrbit | None = None
    allow_old_biases: bool = False
    draw: Callable[[TecResult, pathlib.Path, str], object] | None = None
    systems: str | None = None


@dataclass(frozen=True, eq=False)
class TecOutcome:
    """Result of a task: a summary, or an error message and whether it was one of writing."""

    task: TecTask
    summary: dict[str, Any] | None = None
    error: str | None = None
    is_unwritten: bool = False


def find_tasks(paths: Sequence[pathlib.Path]) -> list[TecTask | TecOutcome]:
    """Return a task for each receiver of each path; an outcome for a bag that cannot be read."""
    tasks: list[TecTask | TecOutcome] = []
    names: collections.Counter[str] = collections.Counter()

    def make_task(path: pathlib.Path, receiver: str | None, name: str) -> TecTask:
        # Files of one name in two folders must not overwrite each other's tables.
        names[name] += 1
        return TecTask(path, receiver, name if names[name] == 1 else f"{name}_{names[name]}")

    for path in paths:
        if not is_bag(path):
            tasks.append(make_task(path, None, path.name.split(".")[0]))
            continue
        bag = TecTask(path, None, path.resolve().name)
        try:
            receivers = bag_receivers(path)
            name = find_run(path).name
        except (BagError, TecError) as error:
            tasks.append(TecOutcome(bag, error=str(error)))
        except OSError as error:
            tasks.append(TecOutcome(bag, error=_describe_error(error, path)))
        else:
            tasks += [
                make_task(path, receiver, name + receiver.replace("/", "_"))
                for receiver in receivers
            ]
    return tasks


def _run_task(task: TecTask, options: TecOptions) -> TecOutcome:
    try:
        if task.receiver is None:
            source = from_file(task.path, options.partial, options.systems)
        else:
            source = from_bag(task.path, task.receiver, options.systems)
        result = process(
            source, options.navigation, options.biases, options.orbit, options.allow_old_biases
        )
    except (BagError, TecError, ObservationFileError, BiasFileError) as error:
        message = str(error)
        prefix = "" if task.path.name in message else f"{task.path}: "
        return TecOutcome(task, error=prefix + message)
    except OSError as error:
        return TecOutcome(task, error=_describe_error(error, task.path))
    try:
        write_tables(result, options.folder, task.name, options.form)
        if options.draw is not None:
            options.draw(result, options.folder, task.name)
    except OSError as error:
        message = _describe_error(error, options.folder)
        return TecOutcome(task, error=message, is_unwritten=True)
    return TecOutcome(task, summary=summarise_result(result))


def _describe_error(error: OSError, path: pathlib.Path) -> str:
    return f"{error.filename or path}: {error.strerror or error}"


@contextlib.contextmanager
def run_tasks(tasks: Sequence[TecTask], options: TecOptions) -> Iterator[Iterator[TecOutcome]]:
    """Process receivers in a context, which yields the outcomes in the order of the tasks.

    Leaving the context ends the tasks that are still running.
    """
    workers = min(len(tasks), os.cpu_count() or 1)
    if workers < 2:
        yield (_run_task(task, options) for task in tasks)
        return
    # Workers are not forked from this process, whose libraries may have started threads.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    with context.Pool(workers, _begin_worker, (options,)) as pool:
        yield pool.imap(_run_in_worker, tasks)


_options_of_worker: TecOptions | None = None


def _begin_worker(options: TecOptions) -> None:
    global _options_of_worker  # noqa: PLW0603 - sent once to each worker, not with each task
    _options_of_worker = options
    # Ctrl-C also reaches the parent, which ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_in_worker(task: TecTask) -> TecOutcome:
    assert _options_of_worker is not None
    return _run_task(task, _options_of_worker)
