"""The Dask cluster that flies a campaign: one of its own on this machine, or any other."""

from __future__ import annotations

import contextlib
import logging
import pathlib
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any

import dask
import distributed

__all__ = ["ClusterError", "RemoteCluster", "connected_client"]

WORKER_DEATHS = 2
"""Workers that a case may end before it is given up."""

_CONNECT_TIMEOUT = 20.0  # s
_LOG_LENGTH = 200


class ClusterError(RuntimeError):
    """A cluster cannot be used, or is gone; the text says what to do."""


@dataclass(frozen=True)
class RemoteCluster:
    """Address of a running Dask scheduler.

    Attributes
    ----------
    address
        ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    ca_file, certificate, key
        PEM files for TLS; None without.
    """

    address: str
    ca_file: pathlib.Path | None = None
    certificate: pathlib.Path | None = None
    key: pathlib.Path | None = None


@contextlib.contextmanager
def connected_client(
    remote: RemoteCluster | None, workers: int, scratch: pathlib.Path
) -> Iterator[Any]:
    """Yield a `distributed.Client`.

    Parameters
    ----------
    remote
        The cluster to use; None for one on this machine, on loopback, which ends with the context.
    workers
        Workers of the cluster on this machine, one core each.
    scratch
        Folder for what these workers write; made.

    Raises
    ------
    ClusterError
        If the scheduler cannot be reached, or the cluster of this machine not be started.
    """
    for name in ("distributed", "tornado", "bokeh", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if remote is not None:
        with _remote_client(remote) as client:
            yield client
        return
    scratch.mkdir(parents=True, exist_ok=True)
    settings = {
        "distributed.scheduler.allowed-failures": WORKER_DEATHS,
        # Loopback answers at once: a worker that does not is dead.
        "distributed.comm.timeouts.connect": f"{_CONNECT_TIMEOUT}s",
        # Workers wait for programs most of the time: nothing in them is worth a profile.
        "distributed.worker.profile.enabled": False,
        # Dask's own records of events, by default 10 000 of each kind, would grow with the cases.
        "distributed.admin.log-length": _LOG_LENGTH,
        "distributed.admin.low-level-log-length": _LOG_LENGTH,
    }
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        # A Ctrl-C of the terminal goes to the workers too: what starts here never gets it.
        with _interrupts_held(), _start_failures_told():
            cluster = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    scheduler_port=0,
                    dashboard_address="127.0.0.1:0",
                    worker_dashboard_address=None,
                    local_directory=str(scratch),
                    silence_logs=logging.CRITICAL,
                )
            )
        yield stack.enter_context(distributed.Client(cluster, set_as_default=False))


@contextlib.contextmanager
def _start_failures_told() -> Iterator[None]:
    """Turn the failure of a cluster to start into an error of one line."""
    try:
        yield
    except (RuntimeError, OSError, TimeoutError) as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise ClusterError(f"no Dask cluster on this machine: {text}") from error


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block SIGINT in this thread; threads and processes that start meanwhile inherit that."""
    # Started later, it would unblock the signal in the thread that starts it.
    resource_tracker.ensure_running()
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


@contextlib.contextmanager
def _remote_client(remote: RemoteCluster) -> Iterator[Any]:
    security = None
    if remote.ca_file is not None:
        security = distributed.Security(
            tls_ca_file=str(remote.ca_file),
            tls_client_cert=str(remote.certificate or remote.ca_file),
            tls_client_key=str(remote.key or remote.certificate or remote.ca_file),
            require_encryption=True,
        )
    try:
        # The loss of the scheduler is reported at once: the campaign can go on with --resume.
        with dask.config.set({"distributed.client.scheduler-info-interval": "2s"}):
            client = distributed.Client(
                remote.address,
                timeout=_CONNECT_TIMEOUT,
                security=security,
                set_as_default=False,
            )
    except (OSError, TimeoutError, ValueError, TypeError, ImportError) as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise ClusterError(f"no Dask scheduler at {remote.address}: {text}") from error
    try:
        yield client
    finally:
        client.close(timeout=5)
