"""A run as one HTML file that opens in any browser, without a server and without other files."""

from __future__ import annotations

import base64
import json
import pathlib
import re
from typing import Any

from vtff_analysis.view.server import CESIUM_FOLDER, WEB_FOLDER

__all__ = ["write_page"]

_MAIN = "main.js"
_IMPORT = re.compile(r'(\bfrom\s+|\bimport\s+)"\./(?P<name>[\w.]+\.js)"')
_MODULE_PREFIX = "vtff/"
#: Pictures of the Earth for the map; an exported page has no globe, which would need 13 MB.
_TILES = CESIUM_FOLDER / "Assets/Textures/NaturalEarthII"
_TILE_LEVEL = "1"


def write_page(content: dict[str, Any], path: pathlib.Path) -> None:
    """Write the page of the viewer with a scene in it.

    Parameters
    ----------
    content
        Scene as `Scene.as_json` returns it.
    path
        File to write.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    scene = {**content, "live": False, "cesium": False, "coast": _earth_pictures()}
    # Nothing in the data may end the element in which it stands.
    text = json.dumps(scene, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    modules = {_MODULE_PREFIX + name: _as_data(_module_text(name)) for name in _modules()}
    import_map = json.dumps({"imports": modules})
    style = (WEB_FOLDER / "style.css").read_text(encoding="utf-8")
    html = (WEB_FOLDER / "index.html").read_text(encoding="utf-8")
    html = html.replace(
        '<link rel="stylesheet" href="style.css">', f"<style>\n{style}</style>"
    ).replace(
        f'<script type="module" src="{_MAIN}"></script>',
        f'<script type="importmap">{import_map}</script>\n'
        f'<script type="application/json" id="scene">{text}</script>\n'
        f'<script type="module">import "{_MODULE_PREFIX}{_MAIN}";</script>',
    )
    path.write_text(html, encoding="utf-8")


def _modules() -> list[str]:
    """Return the names of the main module and of all that it imports."""
    names = [_MAIN]
    for name in names:  # grows meanwhile
        text = (WEB_FOLDER / name).read_text(encoding="utf-8")
        names += [match["name"] for match in _IMPORT.finditer(text) if match["name"] not in names]
    return names


def _module_text(name: str) -> str:
    """Return a module that imports the others by the names of the import map."""
    text = (WEB_FOLDER / name).read_text(encoding="utf-8")
    return _IMPORT.sub(rf'\1"{_MODULE_PREFIX}\g<name>"', text)


def _as_data(text: str) -> str:
    return "data:text/javascript;base64," + base64.b64encode(text.encode()).decode()


def _earth_pictures() -> dict[str, str]:
    return {
        path.relative_to(_TILES).as_posix(): "data:image/jpeg;base64,"
        + base64.b64encode(path.read_bytes()).decode()
        for path in sorted((_TILES / _TILE_LEVEL).glob("*/*.jpg"))
    }
