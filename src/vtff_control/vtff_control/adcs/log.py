"""Logs of the bus of an ADCS module, in candump's format, stamped with scenario time."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator

import can

from vtff_control.adcs.frames import AdcsFrameError, AdcsFrames, AdcsModuleReport
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["AdcsLogError", "AdcsLogWriter", "read_reports"]


class AdcsLogError(ValueError):
    """A log that cannot be used; the text names the file and, where there is one, the line."""


class AdcsLogWriter:
    """Writes frames to a file, one line each; a cut file is readable up to the cut.

    Raises
    ------
    OSError
        If the file cannot be written.
    """

    def __init__(self, path: str | pathlib.Path) -> None:
        self._file = open(path, "w", encoding="ascii", buffering=1)  # noqa: SIM115

    def write(self, frame: can.Message, stamp_nanoseconds: int) -> None:
        """Write a frame with a stamp, ns since 1970."""
        seconds, rest = divmod(stamp_nanoseconds, NANOSECONDS_PER_SECOND)
        self._file.write(
            f"({seconds}.{rest // 1000:06d}) adcs {frame.arbitration_id:03X}#{frame.data.hex()}\n"
        )

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_reports(
    path: str | pathlib.Path, frames: AdcsFrames
) -> Iterator[tuple[int, AdcsModuleReport]]:
    """Return stamp, ns since 1970, and report of each period in a log.

    Damaged lines and frames are left out; a log that is cut in its last line ends there.

    Raises
    ------
    AdcsLogError
        If the file cannot be read, or nothing in it is a report of an ADCS module: it is empty, or
        of another DBC file.
    """
    try:
        lines = pathlib.Path(path).read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise AdcsLogError(f"{path}: cannot be read as a CAN log: {error}") from None
    reports = rejected = 0
    for number, line in enumerate(lines, 1):
        try:
            stamp, frame = _parse(line)
        except ValueError:
            if number == len(lines):
                break  # cut
            raise AdcsLogError(
                f"{path}: line {number}: '(seconds) bus identifier#data' expected, got {line!r}"
            ) from None
        try:
            content = frames.decode(frame)
        except AdcsFrameError:
            rejected += 1
            continue
        if isinstance(content, AdcsModuleReport):
            reports += 1
            yield stamp, content
    if not reports:
        damaged = f"; {rejected} frames of it are damaged" if rejected else ""
        raise AdcsLogError(
            f"{path}: no report of an ADCS module in {len(lines)} lines: another DBC file?{damaged}"
        )


def _parse(line: str) -> tuple[int, can.Message]:
    time, _, content = line.split(maxsplit=2)
    seconds, _, fraction = time.strip("()").partition(".")
    identifier, _, data = content.partition("#")
    frame = can.Message(
        arbitration_id=int(identifier, 16), data=bytes.fromhex(data), is_extended_id=False
    )
    stamp = int(seconds) * NANOSECONDS_PER_SECOND + int(f"{fraction:0<9}"[:9])
    return stamp, frame
