"""Loss of lock, found from the lock times of consecutive epochs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime

__all__ = ["LockTimeTracker", "lock_key"]

_MAX_TOLERANCE = 0.05
"""s; covers the lock-time resolution of the logs (RANGECMP: 1/32 s)."""

_SYSTEM_STRIDE = 1 << 13
_SIGNAL_STRIDE = 1 << 8
_KEYS = 8 * _SYSTEM_STRIDE


def lock_key(
    system: npt.NDArray[np.intp], prn: npt.NDArray[np.intp], signal: npt.NDArray[np.intp]
) -> npt.NDArray[np.intp]:
    """Return a number for each signal, shape (n,); `prn` is below 256, `signal` below 32."""
    return np.asarray(system * _SYSTEM_STRIDE + signal * _SIGNAL_STRIDE + prn)


class LockTimeTracker:
    """Remembers when each signal was last seen and how long it had been locked then.

    A signal has been tracked without interruption if its lock time has grown as much as time has
    passed. A logged lock time may be a lower bound (saturated, or a class of lock times); then
    lock is reported lost only if even the upper bound has not grown enough.
    """

    def __init__(self) -> None:
        #: When each signal was last seen, s since 1980-01-06 (GPS); NaN for never.
        self._seconds = np.full(_KEYS, np.nan)
        #: Its lock time then, s.
        self._lock_time = np.zeros(_KEYS)

    def update(
        self,
        time: GpsTime,
        key: npt.NDArray[np.intp],
        lock_time: npt.NDArray[np.floating],
        lock_time_bound: npt.NDArray[np.floating],
    ) -> npt.NDArray[np.bool_]:
        """Take the lock times of one epoch.

        Parameters
        ----------
        time : GpsTime
            Epoch.
        key : ndarray of int, shape (n,)
            The signals, see `lock_key`.
        lock_time, lock_time_bound : ndarray of float, shape (n,)
            Least and greatest lock time that the log allows, s.

        Returns
        -------
        ndarray of bool, shape (n,)
            Lock was lost since the signal was last seen. False for a signal seen first.
        """
        seconds = time.nanoseconds * 1e-9
        elapsed = seconds - self._seconds[key]
        growth = lock_time_bound - self._lock_time[key]
        # Half of the step at most, or a slip between two 20 Hz epochs would go unseen.
        tolerance = np.minimum(np.maximum(0.5 * elapsed, 0.0), _MAX_TOLERANCE)
        # RANGE has float32 lock times, which grow in coarse steps after some days.
        tolerance += np.spacing(lock_time.astype(np.float32))
        # False where nothing is known, because no comparison with NaN holds.
        is_lost = growth + tolerance <= elapsed
        self._seconds[key] = seconds
        self._lock_time[key] = lock_time
        return np.asarray(is_lost)
