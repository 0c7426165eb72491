"""Observations of a whole file as columns: one row per signal and epoch."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch

__all__ = ["ObservationTable", "signal_keys"]


@dataclass(frozen=True, eq=False)
class ObservationTable:
    """Observations of many epochs, without a Python object per epoch.

    Rows ``first_row[i]`` to ``first_row[i + 1]`` belong to epoch i, in the order of the file.

    Parameters
    ----------
    time_nanoseconds : ndarray of int64, shape (m,)
        Receiver time of each epoch, as `GpsTime.nanoseconds`; increasing.
    first_row : ndarray of int, shape (m + 1,)
    columns : dict of str to ndarray, shape (n,)
        Named and typed as `OBSERVATION_COLUMNS`; see `ObservationEpoch`.
    receiver_clock_offset : ndarray of float64, shape (m,)
        s; NaN where the file does not tell.
    time_status : ndarray of uint8, shape (m,)
    receiver_status : ndarray of uint32, shape (m,)
        Receiver's own codes as in `ObservationEpoch`; 0 where the file has none.
    log_name : str
        Goes into the epochs.
    """

    time_nanoseconds: npt.NDArray[np.int64]
    first_row: npt.NDArray[np.intp]
    columns: dict[str, npt.NDArray[Any]]
    receiver_clock_offset: npt.NDArray[np.float64]
    time_status: npt.NDArray[np.uint8]
    receiver_status: npt.NDArray[np.uint32]
    log_name: str

    @classmethod
    def from_epochs(cls, epochs: Iterable[ObservationEpoch]) -> ObservationTable:
        """Join epochs, which must be in the order of time."""
        listed = list(epochs)
        counts = [len(epoch) for epoch in listed]
        return cls(
            time_nanoseconds=np.array([e.time.nanoseconds for e in listed], dtype=np.int64),
            first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
            columns={
                name: np.concatenate([np.empty(0, kind), *(getattr(e, name) for e in listed)])
                for name, kind in OBSERVATION_COLUMNS.items()
            },
            receiver_clock_offset=np.full(len(listed), np.nan),
            time_status=np.array([e.time_status for e in listed], dtype=np.uint8),
            receiver_status=np.array([e.receiver_status for e in listed], dtype=np.uint32),
            log_name=listed[0].log_name if listed else "",
        )

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.time_nanoseconds)

    @property
    def epoch_index(self) -> npt.NDArray[np.intp]:
        """Epoch of every row, shape (n,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.first_row))

    def time(self, index: int) -> GpsTime:
        """Return the time of an epoch."""
        return GpsTime(int(self.time_nanoseconds[index]))

    def epoch(self, index: int) -> ObservationEpoch:
        """Return one epoch; its columns are views."""
        rows = slice(self.first_row[index], self.first_row[index + 1])
        return ObservationEpoch(
            time=self.time(index),
            time_status=int(self.time_status[index]),
            receiver_status=int(self.receiver_status[index]),
            log_name=self.log_name,
            **{name: column[rows] for name, column in self.columns.items()},
        )

    def epochs(self) -> Iterator[ObservationEpoch]:
        """Yield all epochs."""
        for index in range(len(self)):
            yield self.epoch(index)

    def epochs_at(self, index: npt.NDArray[np.intp]) -> ObservationTable:
        """Return some of the epochs, in the order in which they are asked for.

        Parameters
        ----------
        index : ndarray of int, shape (k,)
            Places of the epochs.
        """
        counts = np.diff(self.first_row)[index]
        first_row = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
        moved = np.repeat(self.first_row[index] - first_row[:-1], counts)
        rows = np.arange(first_row[-1]) + moved
        return dataclasses.replace(
            self,
            time_nanoseconds=self.time_nanoseconds[index],
            first_row=first_row,
            columns={name: column[rows] for name, column in self.columns.items()},
            receiver_clock_offset=self.receiver_clock_offset[index],
            time_status=self.time_status[index],
            receiver_status=self.receiver_status[index],
        )

    def select(
        self, systems: str | None = None, signals: Collection[str] | None = None
    ) -> ObservationTable:
        """Return the same epochs with some of the signals.

        Parameters
        ----------
        systems : str, optional
            RINEX letters, e.g. ``"GE"``.
        signals : collection of str, optional
            Band and attribute, e.g. ``("1C", "2W")``.
        """
        is_kept = np.ones(len(self.columns["prn"]), dtype=np.bool_)
        if systems is not None:
            numbers = [c.SYSTEM_LETTERS.index(letter) for letter in systems]
            is_kept &= np.isin(self.columns["system"], numbers)
        if signals is not None:
            codes = [int(signal[0]) << 8 | ord(signal[1]) for signal in signals]
            is_kept &= np.isin(
                self.columns["band"].astype(int) << 8 | self.columns["attribute"], codes
            )
        return self.rows(is_kept)

    def rows(self, is_kept: npt.NDArray[np.bool_]) -> ObservationTable:
        """Return the same epochs with some of the rows, given by a mask of shape (n,)."""
        kept_before = np.concatenate([[0], np.cumsum(is_kept)])
        return dataclasses.replace(
            self,
            first_row=kept_before[self.first_row].astype(np.intp),
            columns={name: column[is_kept] for name, column in self.columns.items()},
        )

    def by_satellite(
        self, name: str, system: int, band: int, attribute: str
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[Any]]:
        """Return a column of one signal as a matrix of epochs and satellites.

        Parameters
        ----------
        name : str
            One of `OBSERVATION_COLUMNS`.
        system, band, attribute
            ``SYSTEM_*``, RINEX frequency digit and tracking attribute, e.g. ``"C"``.

        Returns
        -------
        prn : ndarray of uint8, shape (k,)
            Increasing.
        values : ndarray, shape (m, k)
            Where there is no observation NaN, or 0 in a column of integers.
        """
        chosen = np.flatnonzero(
            (self.columns["system"] == system)
            & (self.columns["band"] == band)
            & (self.columns["attribute"] == ord(attribute))
        )
        prn, column_of_row = np.unique(self.columns["prn"][chosen], return_inverse=True)
        column = self.columns[name]
        missing = np.nan if column.dtype.kind == "f" else 0
        values = np.full((len(self), len(prn)), missing, dtype=column.dtype)
        values[self.epoch_index[chosen], column_of_row] = column[chosen]
        return prn, values


def signal_keys(columns: dict[str, npt.NDArray[Any]]) -> npt.NDArray[np.int64]:
    """Return a number for each row; rows of one signal of one satellite have the same number."""
    key = columns["system"].astype(np.int64)
    for name in ("prn", "band", "attribute"):
        key = key << 8 | columns[name]
    return key
