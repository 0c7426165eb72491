"""Count the forms of functions that this process has compiled or loaded."""

from __future__ import annotations

import sys

from numba.core.dispatcher import Dispatcher


def compiled_forms() -> dict[str, int]:
    """Return for how many types of arguments each compiled function of vtff is there."""
    forms = {}
    for module in [module for name, module in sys.modules.items() if name.startswith("vtff_")]:
        for value in vars(module).values():
            if isinstance(value, Dispatcher) and value.signatures:
                forms[f"{value.__module__}.{value.__qualname__}"] = len(value.signatures)
    return forms
