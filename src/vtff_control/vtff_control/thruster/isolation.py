"""Axes of a thruster that the safety monitor shuts off, as bits of a message and in words."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["isolated_axes", "isolated_text", "isolation_bits"]

_BITS = np.array([1, 2, 4])


def isolated_axes(bits: int) -> npt.NDArray[np.bool_]:
    """Return whether R, T and N are shut off, shape (3,), from the bits of a message."""
    return np.asarray((bits & _BITS) != 0)


def isolation_bits(axes: npt.ArrayLike) -> int:
    """Return the bits of a message; the inverse of `isolated_axes`."""
    radial, along_track, normal = np.asarray(axes, dtype=bool).tolist()
    return int(radial) + 2 * int(along_track) + 4 * int(normal)


def isolated_text(axes: npt.ArrayLike) -> str:
    """Return the names of the axes that are shut off."""
    return ", ".join(name for name, is_it in zip("RTN", np.asarray(axes), strict=True) if is_it)
