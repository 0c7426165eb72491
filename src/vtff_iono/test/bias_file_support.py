"""Bias files that tests write line by line."""

from __future__ import annotations

import gzip
import pathlib


def sinex_line(
    kind: str,
    name: str,
    station: str,
    first: str,
    second: str,
    value: float,
    sigma: float,
    unit: str = "ns",
    end: str = "2024:011:00000",
) -> str:
    """Return a line of BIAS/SOLUTION in the columns of version 1.00, valid from 2024-01-10 on."""
    return (
        f" {kind:4} G063 {name:3} {station:9} {first:4} {second:4} 2024:010:00000 {end:14} "
        f"{unit:4} {value:21.4f} {sigma:11.4f}"
    )


def sinex_file(folder: pathlib.Path, *lines: str, name: str = "test.BIA") -> pathlib.Path:
    """Write lines as a Bias-SINEX file, compressed if the name says so; return its path."""
    path = folder / name
    text = "\n".join(("%=BIA 1.00 TST", "+BIAS/SOLUTION", "*BIAS", *lines, "-BIAS/SOLUTION", ""))
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return path
