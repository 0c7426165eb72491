"""A run as one HTML file that opens in any browser, without a server and without other files."""

from __future__ import annotations

import base64
import json
import pathlib
from typing import Any

from vtff_analysis.view.page_modules import import_map
from vtff_analysis.view.server import CESIUM_FOLDER, WEB_FOLDER

__all__ = ["write_page"]

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
    modules, main = import_map(WEB_FOLDER / "main.js")
    style = (WEB_FOLDER / "style.css").read_text(encoding="utf-8")
    html = (WEB_FOLDER / "index.html").read_text(encoding="utf-8")
    html = html.replace(
        '<link rel="stylesheet" href="style.css">', f"<style>\n{style}</style>"
    ).replace(
        '<script type="module" src="main.js"></script>',
        f'<script type="importmap">{json.dumps({"imports": modules})}</script>\n'
        f'<script type="application/json" id="scene">{text}</script>\n'
        f'<script type="module">import "{main}";</script>',
    )
    path.write_text(html, encoding="utf-8")


def _earth_pictures() -> dict[str, str]:
    return {
        path.relative_to(_TILES).as_posix(): "data:image/jpeg;base64,"
        + base64.b64encode(path.read_bytes()).decode()
        for path in sorted((_TILES / _TILE_LEVEL).glob("*/*.jpg"))
    }
