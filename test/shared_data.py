"""Reference data that stand outside the repository: the folder `shared` beside the checkout.

They are recordings of real receivers and simulators, too large for the repository. The environment
variable ``VTFF_SHARED`` names another folder. A test that needs them is skipped where they are
absent; ``conftest.py`` counts these skips in one line after the tests.
"""

from __future__ import annotations

import os
import pathlib

import pytest

_BESIDE_THE_CHECKOUT = pathlib.Path(__file__).resolve().parents[2] / "shared"

#: How the reason of every skip for want of reference data begins.
ABSENT = "no reference data"


def shared_folder() -> pathlib.Path:
    """Return the folder of reference data, whether it is there or not."""
    return pathlib.Path(os.environ.get("VTFF_SHARED", _BESIDE_THE_CHECKOUT))


def require_shared(path: str | pathlib.Path = "") -> pathlib.Path:
    """Return a file or folder of the reference data, or skip the test.

    Parameters
    ----------
    path
        Relative to the folder of reference data; the folder itself without it.

    """
    wanted = shared_folder() / path
    if not wanted.exists():
        pytest.skip(f"{ABSENT}: {wanted} (VTFF_SHARED)")
    return wanted


def needs_shared(path: str) -> pytest.MarkDecorator:
    """Return the mark of tests that need a file or folder of the reference data."""
    wanted = shared_folder() / path
    return pytest.mark.skipif(not wanted.exists(), reason=f"{ABSENT}: {wanted} (VTFF_SHARED)")
