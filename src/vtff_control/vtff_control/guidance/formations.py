"""Formation files: mean relative elements of every spacecraft of named formations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["read_formations"]


def read_formations(
    fields: object, file: str, spacecraft: Sequence[str]
) -> dict[str, dict[str, FloatArray]]:
    """Return the mean relative elements of every spacecraft in each formation, m, shape (6,).

    They are relative to a virtual reference orbit without thrust, as in
    `vtff_dynamics.relative.relative_elements`: (delta a, delta lambda, delta e_x, delta e_y,
    delta i_x, delta i_y) times the semi-major axis.

    Parameters
    ----------
    fields
        Content of the file: ``formation: {spacecraft: [6 numbers]}``.
    file
        Its name, for messages.
    spacecraft
        Names that each formation must have.

    Raises
    ------
    ValueError
        If the fields have another form; the text names file and field.
    """
    if not isinstance(fields, Mapping) or not fields:
        raise ValueError(f"{file}: formations expected, each with its spacecraft")
    formations: dict[str, dict[str, FloatArray]] = {}
    for formation, designs in fields.items():
        if not isinstance(designs, Mapping) or set(designs) != set(spacecraft):
            raise ValueError(
                f"{file}: {formation}: the spacecraft {', '.join(spacecraft)} expected"
            )
        formations[str(formation)] = {}
        for name in spacecraft:
            values = designs[name]
            if (
                not isinstance(values, Sequence)
                or len(values) != 6
                or not all(_is_number(value) for value in values)
            ):
                raise ValueError(f"{file}: {formation}.{name}: six numbers (m) expected")
            formations[str(formation)][name] = np.array(values, dtype=float)
    return formations


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
