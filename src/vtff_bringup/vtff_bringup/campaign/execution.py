"""Flies the cases of a campaign on a Dask cluster, a bounded number at a time."""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from distributed.scheduler import KilledWorker

from vtff_bringup.campaign.cases import Case
from vtff_bringup.campaign.cluster import ClusterError
from vtff_bringup.campaign.plan import FlightPlan
from vtff_bringup.campaign.run_flight import end_flights
from vtff_bringup.campaign.worker import LOST, fly_cases, make_record

__all__ = ["Flight", "fly_campaign"]

Flight = Callable[[FlightPlan, Sequence[Case]], list[dict[str, Any]]]
"""Flies cases and returns their records, on a worker."""

_TASKS_PER_THREAD = 2
"""Tasks given to the scheduler for each thread of its workers: the next is there when one ends."""

_SIZE_INTERVAL = 5.0  # s between looks at the size of the cluster
_POLL = 0.5  # s
_END_PATIENCE = 50.0  # s that cases get to end in order


def fly_campaign(
    client: Any,
    plan: FlightPlan,
    cases: Sequence[Case],
    on_record: Callable[[dict[str, Any]], None],
    batch: int = 1,
    fly: Flight = fly_cases,
) -> None:
    """Fly cases; `on_record` gets the record of each when it is done, in any order.

    Parameters
    ----------
    client
        A `distributed.Client`.
    plan
        Plan that all cases share.
    cases
        Cases to fly.
    on_record
        Called in this thread.
    batch
        Cases of a task of Dask.
    fly
        Function that a worker calls with a batch of cases.

    Raises
    ------
    ClusterError
        If the scheduler is lost.
    KeyboardInterrupt
        Passed on, after what is in the air has been ended.
    """
    batches = [tuple(cases[start : start + batch]) for start in range(0, len(cases), batch)]
    flights = _Flights(client, plan, batches, fly)
    try:
        for records in flights.completed():
            for record in records:
                on_record(record)
    except ClusterError:
        raise
    except BaseException:
        flights.end()
        raise


class _Flights:
    """The tasks of a campaign that a scheduler knows."""

    def __init__(
        self, client: Any, plan: FlightPlan, batches: Iterable[tuple[Case, ...]], fly: Flight
    ) -> None:
        self._client = client
        self._fly = fly
        self._plan = plan
        self._waiting = deque(batches)
        self._flying: dict[str, tuple[Any, tuple[Case, ...]]] = {}
        self._done: queue.SimpleQueue[str] = queue.SimpleQueue()
        # Several campaigns may share a scheduler.
        self._prefix = f"{plan.campaign}-{uuid.uuid4().hex[:8]}"
        self._window = 0
        self._window_time = 0.0
        self._submitted = 0

    def completed(self) -> Iterable[list[dict[str, Any]]]:
        """Yield the records of each batch that is done."""
        while self._waiting or self._flying:
            self._submit()
            for key in self._keys_done():
                future, batch = self._flying.pop(key)
                yield from self._records(future, batch)
                future.release()

    def end(self) -> None:
        """Take back what has not begun, and end what is in the air."""
        futures = [future for future, _ in self._flying.values()]
        with contextlib.suppress(Exception):
            running = self._client.run(end_flights, self._plan.folder)
            self._client.cancel(futures, force=True)
            deadline = time.monotonic() + _END_PATIENCE
            while any(running.values()) and time.monotonic() < deadline:
                time.sleep(_POLL)
                running = self._client.run(end_flights, self._plan.folder, 0)

    def _submit(self) -> None:
        self._look_at_size()
        while self._waiting and len(self._flying) < self._window:
            batch = self._waiting.popleft()
            self._submitted += 1
            key = f"{self._prefix}-{batch[0].number}-{self._submitted}"
            future = self._client.submit(self._fly, self._plan, batch, key=key, pure=False)
            self._flying[key] = (future, batch)
            future.add_done_callback(lambda done: self._done.put(done.key))

    def _look_at_size(self) -> None:
        """Follow a cluster that grows or shrinks."""
        now = time.monotonic()
        if self._window and now - self._window_time < _SIZE_INTERVAL:
            return
        self._window_time = now
        try:
            threads = sum(self._client.nthreads().values())
        except (OSError, ValueError, RuntimeError, AttributeError) as error:
            raise self._lost() from error
        self._window = max(2, _TASKS_PER_THREAD * threads)

    def _keys_done(self) -> list[str]:
        """Return the keys of what is done; empty after a while without any."""
        keys = []
        with contextlib.suppress(queue.Empty):
            keys.append(self._done.get(timeout=_POLL))
            while True:
                keys.append(self._done.get_nowait())
        return [key for key in keys if key in self._flying]

    def _records(self, future: Any, batch: tuple[Case, ...]) -> Iterable[list[dict[str, Any]]]:
        if future.status == "finished":
            try:
                yield future.result()
            except (OSError, TimeoutError) as error:
                raise self._lost() from error
            return
        if future.cancelled() or self._client.status != "running":
            raise self._lost()
        if len(batch) > 1:
            # One of them ended its worker; which one shows when each is flown by itself.
            self._waiting.extendleft((case,) for case in reversed(batch))
            return
        yield [make_record(batch[0], LOST, _reason(future.exception()))]

    def _lost(self) -> ClusterError:
        return ClusterError(f"the Dask scheduler {self._client.scheduler.address} is lost")


def _reason(error: BaseException) -> str:
    """Tell on one line why Dask gave a case up."""
    if isinstance(error, KilledWorker):
        count = error.allowed_failures + 1
        return f"ended its worker {count} times (crash, too little memory, or over the time-out)"
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
