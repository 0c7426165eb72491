"""Satellite records of RINEX observation files to columns: fixed fields, validity, strength."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_gnss import constants as c
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.fixed_point import FIELD_WIDTH, digits_or_blank, parse_fixed_point
from vtff_gnss.rinex.observation_epochs import Batch
from vtff_gnss.rinex.observation_header import RinexObservationHeader
from vtff_gnss.rinex.observation_signals import SignalColumns, signal_columns

__all__ = ["FieldError", "RecordReader", "SignalRows"]

_STRIDE = 16
_LOCK_LOST_BIT = 1
_HALF_CYCLE_BIT = 2
# Signal strength digit n stands for 6 n to 6 n + 6 dB-Hz (RINEX 3.05, section 5.7).
_STRENGTH_STEP_DBHZ = 6.0
_STRENGTH_MIDDLE_DBHZ = 3.0


@dataclass(frozen=True)
class FieldError:
    """A malformed field: its line, its epoch and the exception that tells."""

    line_number: int
    epoch: int
    error: RinexError


@dataclass(frozen=True)
class SignalRows:
    """One row per signal: epoch, number of its line, and the columns of `OBSERVATION_COLUMNS`."""

    epoch: npt.NDArray[np.intp]
    line_number: npt.NDArray[np.intp]
    columns: dict[str, npt.NDArray[Any]]

    def before_epoch(self, epoch: int) -> SignalRows:
        """Return the rows of earlier epochs."""
        return self.take(slice(0, int(np.searchsorted(self.epoch, epoch))))

    def take(self, rows: npt.NDArray[np.intp] | slice) -> SignalRows:
        """Return some of the rows."""
        columns = {name: column[rows] for name, column in self.columns.items()}
        return SignalRows(self.epoch[rows], self.line_number[rows], columns)


class RecordReader:
    """Reads the satellite records that `walk_epochs` has found.

    Malformed fields are gathered in `errors`; their rows are left out.
    """

    def __init__(
        self,
        lines: Sequence[bytes],
        header: RinexObservationHeader,
        name: str,
        systems: str | None,
        signals: Collection[str] | None,
        rinex2_attributes: Mapping[str, Mapping[str, str]],
    ) -> None:
        self.errors: list[FieldError] = []
        self._lines = lines
        self._header = header
        self._name = name
        self._systems = c.SYSTEM_LETTERS if systems is None else systems
        self._signals = None if signals is None else frozenset(signals)
        self._rinex2_attributes = rinex2_attributes
        channels = np.full(256, c.GLONASS_CHANNEL_UNKNOWN, dtype=np.int8)
        for slot, channel in header.glonass_channels.items():
            channels[slot] = channel
        self._glonass_channels = channels

    def read(self, batches: Sequence[Batch]) -> SignalRows:
        """Return the rows of all batches in the order of the file."""
        blocks = [_no_rows()]
        for batch in batches:
            blocks += self._read_batch(batch)
        rows = SignalRows(
            np.concatenate([block.epoch for block in blocks]),
            np.concatenate([block.line_number for block in blocks]),
            {
                name: np.concatenate([block.columns[name] for block in blocks])
                for name in OBSERVATION_COLUMNS
            },
        )
        return rows.take(np.argsort(rows.line_number, kind="stable"))

    def _read_batch(self, batch: Batch) -> list[SignalRows]:
        names = b"".join([satellite.ljust(3)[:3] for satellite in batch.satellites])
        characters = np.frombuffer(names, dtype=np.uint8).reshape(-1, 3)
        epoch = np.array(batch.epochs, dtype=np.intp)
        line_number = np.array(batch.line_indices, dtype=np.intp) + 1
        digits = digits_or_blank(characters[:, 1:]).astype(np.intp)
        prn = 10 * digits[:, 0] + digits[:, 1]
        letters = characters[:, 0]
        is_unknown = (digits > 9).any(axis=1) | (prn == 0)
        is_unknown |= ~np.isin(letters, np.frombuffer(c.SYSTEM_LETTERS.encode(), np.uint8))
        self._note(is_unknown, line_number, epoch, lambda i: f"satellite {batch.satellites[i]!r}")
        blocks = []
        for letter in c.SYSTEM_LETTERS:
            chosen = np.flatnonzero((letters == ord(letter)) & ~is_unknown)
            if not len(chosen):
                continue
            if letter not in batch.types and "" not in batch.types:
                self._note_first(chosen, line_number, epoch, f"no types for system {letter}")
            elif letter in self._systems:
                records = _Records(letter, prn[chosen], epoch[chosen], line_number[chosen])
                blocks.append(self._read_system(batch, records))
        return blocks

    def _read_system(self, batch: Batch, records: _Records) -> SignalRows:
        """Read all records of one system."""
        letter = records.letter
        types = batch.types[letter if letter in batch.types else ""]
        signals = signal_columns(letter, types, self._header.version, self._rinex2_attributes)
        if self._signals is not None:
            signals = [s for s in signals if f"{s.band}{s.attribute}" in self._signals]
        fields, lengths = self._fields(batch, records, len(types))
        used = sorted({column for s in signals for column in s[2:] if column >= 0})
        if not used:
            return _no_rows()
        values, lock, strength, is_bad = self._values(records, types, used, fields, lengths)
        for j, column in enumerate(used):
            scale = batch.scale_factors.get((letter, types[column]))
            scale = scale or batch.scale_factors.get((letter, ""), 1.0)
            values[:, j] /= scale
        # The last, empty column stands for values that a signal does not have.
        index = np.full(len(types) + 1, len(used))
        index[used] = np.arange(len(used))
        rows = self._signal_rows(records, signals, values, lock, strength, index)
        if is_bad.any():
            is_kept = ~np.isin(rows.line_number, records.line_number[is_bad])
            rows = rows.take(np.flatnonzero(is_kept))
        return rows

    def _fields(
        self, batch: Batch, records: _Records, type_count: int
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.intp]]:
        """Return characters (n, types, 16) and the number of characters of each record."""
        lines, first, width = self._lines, (records.line_number - 1).tolist(), _STRIDE * type_count
        if self._header.version < 3.0:
            per_record = batch.lines_per_record_2
            texts = [
                b"".join([line.ljust(80)[:80] for line in lines[i : i + per_record - 1]])
                + (lines[i + per_record - 1] if per_record else b"")
                for i in first
            ]
        else:
            texts = [lines[i][3:] for i in first]
        lengths = np.fromiter(map(len, texts), np.intp, len(texts))
        for i in np.flatnonzero(lengths > width):
            if texts[i][width:].strip():
                self._note_first(
                    np.array([i]), records.line_number, records.epoch,
                    f"more values than the {type_count} types of the header",
                )  # fmt: skip
        joined = b"".join([text[:width].ljust(width) for text in texts])
        characters = np.frombuffer(joined, dtype=np.uint8)
        return characters.reshape(len(texts), type_count, _STRIDE), lengths

    def _values(
        self,
        records: _Records,
        types: tuple[str, ...],
        used: list[int],
        fields: npt.NDArray[np.uint8],
        lengths: npt.NDArray[np.intp],
    ) -> tuple[
        npt.NDArray[np.float64],
        npt.NDArray[np.uint8],
        npt.NDArray[np.uint8],
        npt.NDArray[np.bool_],
    ]:
        """Return values, loss-of-lock and strength digits, each (n, used + 1), and bad records."""
        chosen = fields[:, used, :]
        count = (len(chosen), len(used))
        numbers = np.ascontiguousarray(chosen[..., :FIELD_WIDTH]).reshape(-1, FIELD_WIDTH)
        parsed, is_irregular = parse_fixed_point(numbers)
        digits = digits_or_blank(chosen[..., FIELD_WIDTH:])
        bad_cells = np.zeros(count, dtype=np.bool_)
        for cell in np.flatnonzero(is_irregular):
            row, j = divmod(int(cell), count[1])
            number = _irregular_number(numbers[cell])
            if number is None or lengths[row] < used[j] * _STRIDE + FIELD_WIDTH:
                bad_cells[row, j] = True
            else:
                parsed[cell] = number
        bad_cells |= (digits > 9).any(axis=2)
        for row, j in zip(*np.nonzero(bad_cells), strict=True):
            self._note_first(
                np.array([row]), records.line_number, records.epoch,
                f"{records.letter}{records.prn[row]:02d} {types[used[j]]}: "
                f"{bytes(chosen[row, j]).decode('ascii', 'replace')!r} is not F14.3 and two digits",
            )  # fmt: skip
        values = np.full((count[0], count[1] + 1), np.nan)
        values[:, :-1] = parsed.reshape(count)
        lock, strength = (np.zeros(values.shape, np.uint8) for _ in range(2))
        lock[:, :-1], strength[:, :-1] = digits[..., 0], digits[..., 1]
        return values, lock, strength, np.asarray(bad_cells.any(axis=1))

    def _signal_rows(
        self,
        records: _Records,
        signals: list[SignalColumns],
        values: npt.NDArray[np.float64],
        lock: npt.NDArray[np.uint8],
        strength: npt.NDArray[np.uint8],
        index: npt.NDArray[np.intp],
    ) -> SignalRows:
        """Return the signals that have a value, record by record."""
        places = np.array([signal[2:] for signal in signals], dtype=np.intp)
        code_at, phase_at, doppler_at, strength_at = (index[places[:, q]] for q in range(4))
        code, phase, doppler = values[:, code_at], values[:, phase_at], values[:, doppler_at]
        code = np.where(code == 0.0, np.nan, code)
        phase = np.where(phase == 0.0, np.nan, phase)
        has_code, has_phase = ~np.isnan(code), ~np.isnan(phase)
        row, s = np.nonzero(has_code | has_phase | (np.nan_to_num(doppler) != 0.0))
        has_code, has_phase = has_code[row, s], has_phase[row, s]
        bits = lock[:, phase_at][row, s]
        band = np.array([signal.band for signal in signals])[s]
        # Squaring receivers of RINEX 2, whose ambiguities bit 1 turns to whole cycles.
        is_squared = np.array([1, *self._header.wavelength_factors])[np.minimum(band, 2)] == 2
        is_half = ((bits & _HALF_CYCLE_BIT) != 0) ^ is_squared
        flags = has_code * c.FLAG_CODE_VALID | has_phase * c.FLAG_PHASE_VALID
        flags |= (has_phase & ~is_half) * c.FLAG_PARITY_KNOWN
        flags |= ((bits & _LOCK_LOST_BIT) != 0) * c.FLAG_LOCK_LOST
        system = c.SYSTEM_LETTERS.index(records.letter)
        prn = records.prn[row]
        columns = {
            "system": np.full(len(row), system),
            "prn": prn,
            "band": band,
            "attribute": np.array([ord(signal.attribute) for signal in signals])[s],
            "glonass_channel": self._glonass_channels[prn] * (system == c.SYSTEM_GLONASS),
            "pseudorange": code[row, s],
            "carrier_phase_cycles": phase[row, s],
            "doppler_hz": doppler[row, s],
            "cn0_dbhz": _cn0(values, strength, strength_at, phase_at, code_at)[row, s],
            "flags": flags,
        }
        # RINEX has no sigmas; the lock time is found from all epochs together.
        absent = np.full(len(row), np.nan)
        typed = {
            name: columns.get(name, absent).astype(kind)
            for name, kind in OBSERVATION_COLUMNS.items()
        }
        return SignalRows(records.epoch[row], records.line_number[row], typed)

    def _note(self, is_wrong: Any, line_number: Any, epoch: Any, reason: Any) -> None:
        for i in np.flatnonzero(is_wrong)[:1]:
            self._note_first(np.array([i]), line_number, epoch, f"{reason(i)} is unknown")

    def _note_first(
        self,
        chosen: npt.NDArray[np.intp],
        line_number: npt.NDArray[np.intp],
        epoch: npt.NDArray[np.intp],
        reason: str,
    ) -> None:
        number = int(line_number[chosen[0]])
        error = RinexError(f"{self._name}:{number}: {reason}")
        self.errors.append(FieldError(number, int(epoch[chosen[0]]), error))


@dataclass(frozen=True)
class _Records:
    """Records of one system; arrays of shape (n,)."""

    letter: str
    prn: npt.NDArray[np.intp]
    epoch: npt.NDArray[np.intp]
    line_number: npt.NDArray[np.intp]


def _no_rows() -> SignalRows:
    nothing = np.empty(0, dtype=np.intp)
    columns = {name: np.empty(0, kind) for name, kind in OBSERVATION_COLUMNS.items()}
    return SignalRows(nothing, nothing, columns)


def _irregular_number(characters: npt.NDArray[np.uint8]) -> float | None:
    """Return a number that is not written as F14.3; None if it is none."""
    try:
        value = float(bytes(characters))
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _cn0(
    values: npt.NDArray[np.float64],
    strength: npt.NDArray[np.uint8],
    strength_at: npt.NDArray[np.intp],
    phase_at: npt.NDArray[np.intp],
    code_at: npt.NDArray[np.intp],
) -> npt.NDArray[np.float64]:
    """Return S values, else the middle of the class of the strength digit, else NaN; (n, s)."""
    digit = np.where(strength[:, phase_at] > 0, strength[:, phase_at], strength[:, code_at])
    from_digit = np.where(digit > 0, digit * _STRENGTH_STEP_DBHZ + _STRENGTH_MIDDLE_DBHZ, np.nan)
    stated = values[:, strength_at]
    return np.where(np.isnan(stated) | (stated == 0.0), from_digit, stated)
