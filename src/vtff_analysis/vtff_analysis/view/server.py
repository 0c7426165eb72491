"""Web server of the viewer: the page, the scene as JSON, and new samples of a live scene.

It listens on this machine only. The policy of the page forbids requests to other machines.
"""

from __future__ import annotations

import http.server
import json
import mimetypes
import pathlib
import threading
import time
import urllib.parse
from collections.abc import Callable, Mapping
from typing import Any

WEB_FOLDER = pathlib.Path(__file__).resolve().parent / "web"
#: tools/install_viewer.sh installs it at set-up; without it the page shows a map.
CESIUM_FOLDER = WEB_FOLDER / "cesium"

HOST = "127.0.0.1"
NEWS_INTERVAL = 0.5  # s of wall time between news of a live scene
LARGEST_COMMAND = 4096  # bytes

#: The page loads nothing from elsewhere. Cesium compiles expressions and starts workers from blobs.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self' data: blob:"
)
_TYPES = {".js": "text/javascript", ".json": "application/json", ".wasm": "application/wasm"}

News = Callable[[Mapping[str, int]], tuple[dict[str, Any], dict[str, int]]]
Command = Callable[[str, float], str]


def cesium_is_installed() -> bool:
    """Return whether Cesium, which draws the globe, is installed."""
    return (CESIUM_FOLDER / "index.js").is_file()


class ViewerServer(http.server.ThreadingHTTPServer):
    """Serves the page on a free port of this machine.

    Parameters
    ----------
    scene
        Function that returns the scene as the page loads it.
    news
        For a live scene: function that takes the number of samples that a page has by series, and
        returns the scene with the new samples and the numbers after it. Each open page has its own
        numbers.
    command
        For a live replay: function that takes ``pause``, ``resume``, ``seek`` or ``rate`` and a
        number, and returns the answer of the replay.
    port
        Port of the page; 0 for a free one.

    Raises
    ------
    OSError
        If the port is taken.
    """

    daemon_threads = True
    # A page that was just closed does not keep its port from the next server.
    allow_reuse_address = True

    def __init__(
        self,
        scene: Callable[[], dict[str, Any]],
        news: News | None = None,
        command: Command | None = None,
        port: int = 0,
    ) -> None:
        super().__init__((HOST, port), _Handler)
        self.scene = scene
        self.news = news
        self.command = command
        self.closing = threading.Event()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server_address[1]}/"

    def start(self) -> None:
        """Serve in a thread until `stop`."""
        threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True).start()

    def stop(self) -> None:
        """End the server and its open pages."""
        self.closing.set()
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Stay silent: a page that is closed breaks its connections."""


class _Handler(http.server.BaseHTTPRequestHandler):
    """Answers one request."""

    server: ViewerServer
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Answer with the scene, its news, or a file of the page."""
        path = urllib.parse.unquote(urllib.parse.urlsplit(self.path).path)
        if not self._is_for_this_server():
            self.send_error(http.HTTPStatus.FORBIDDEN)
        elif path == "/scene.json":
            self._send_json({**self.server.scene(), "cesium": cesium_is_installed()})
        elif path == "/news" and self.server.news is not None:
            self._send_news(self.server.news)
        else:
            self._send_file(path)

    def do_POST(self) -> None:
        """Hand a command to the replay."""
        length = int(self.headers.get("Content-Length") or 0)
        if not self._is_for_this_server() or self.path != "/command" or self.server.command is None:
            self.send_error(http.HTTPStatus.FORBIDDEN)
            return
        try:
            request = json.loads(self.rfile.read(min(length, LARGEST_COMMAND)))
            answer = self.server.command(str(request["command"]), float(request.get("value", 0.0)))
        except (KeyError, TypeError, ValueError) as error:
            self.send_error(http.HTTPStatus.BAD_REQUEST, str(error)[:200])
            return
        self._send_json({"message": answer})

    def log_message(self, format: str, *arguments: Any) -> None:
        """Stay silent: the terminal is the user's."""

    def _is_for_this_server(self) -> bool:
        """Return whether the request names this server: a site may resolve its name to it."""
        host = self.server.address.removeprefix("http://").rstrip("/")
        return self.headers.get("Host") in (host, host.replace(HOST, "localhost"))

    def _send_json(self, content: dict[str, Any]) -> None:
        body = json.dumps(content, allow_nan=False, separators=(",", ":")).encode()
        self.send_response(http.HTTPStatus.OK)
        self.send_header("Cache-Control", "no-store")
        self._send_body("application/json", body)

    def _send_file(self, path: str) -> None:
        file = (WEB_FOLDER / (path.lstrip("/") or "index.html")).resolve()
        if not file.is_relative_to(WEB_FOLDER) or not file.is_file():
            self.send_error(http.HTTPStatus.NOT_FOUND)
            return
        content_type = _TYPES.get(file.suffix) or mimetypes.guess_type(file.name)[0]
        self.send_response(http.HTTPStatus.OK)
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Cache-Control", "no-cache")
        self._send_body(content_type or "application/octet-stream", file.read_bytes())

    def _send_body(self, content_type: str, body: bytes) -> None:
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _send_news(self, news: News) -> None:
        """Send server-sent events until the page or the server closes."""
        self.send_response(http.HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        sent: dict[str, int] = {}
        while not self.server.closing.is_set():
            content, sent = news(sent)
            text = json.dumps(content, allow_nan=False, separators=(",", ":"))
            try:
                self.wfile.write(f"data: {text}\n\n".encode())
                self.wfile.flush()
            except OSError:
                return
            time.sleep(NEWS_INTERVAL)
