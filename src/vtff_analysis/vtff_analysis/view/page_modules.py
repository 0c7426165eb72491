"""Modules of a page as an import map of data, so that one HTML file holds them all."""

from __future__ import annotations

import base64
import pathlib
import re

__all__ = ["import_map"]

_WEB_FOLDER = pathlib.Path(__file__).resolve().parent / "web"
_IMPORT = re.compile(r'(\bfrom\s+|\bimport\s+)"\./(?P<name>[\w.]+\.js)"')
_PREFIX = "vtff/"


def import_map(main: pathlib.Path) -> tuple[dict[str, str], str]:
    """Return the modules that a page needs, and the name by which its main module is imported.

    Parameters
    ----------
    main
        File of the main module. Modules that it imports stand beside it or in the folder of the
        viewer's page.

    Returns
    -------
    dict, str
        Addresses of the modules as ``data:`` by name, and the name of the main module.

    Raises
    ------
    OSError
        If a module cannot be read.
    """
    names = [main.name]
    modules = {}
    for name in names:  # grows meanwhile
        beside = main.parent / name
        path = beside if beside.is_file() else _WEB_FOLDER / name
        text = path.read_text(encoding="utf-8")
        names += [match["name"] for match in _IMPORT.finditer(text) if match["name"] not in names]
        # A module that is data has no place beside which another could stand.
        text = _IMPORT.sub(rf'\1"{_PREFIX}\g<name>"', text)
        encoded = base64.b64encode(text.encode()).decode()
        modules[_PREFIX + name] = f"data:text/javascript;base64,{encoded}"
    return modules, _PREFIX + main.name
