"""Work on an epoch that its solution need not wait for."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["LaterWork"]


class LaterWork:
    """Work that is done at once or, if so asked for, when there is time.

    Attributes
    ----------
    is_put_off : bool
        Whether work waits for `do`; False at first.
    """

    def __init__(self) -> None:
        self.is_put_off = False
        self._work: list[Callable[[], None]] = []

    def add(self, work: Callable[[], None]) -> None:
        """Do work now, or keep it for later."""
        if self.is_put_off:
            self._work.append(work)
        else:
            work()

    def do(self) -> None:
        """Do what has been put off, in its order."""
        waiting, self._work = self._work, []
        for work in waiting:
            work()

    def forget(self) -> None:
        """Forget what has been put off."""
        self._work.clear()
