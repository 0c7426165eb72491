"""Web server of the viewer: the page, the scene as JSON, and new samples of a live scene.

It listens on this machine only. The policy of the page forbids requests to other machines.

Any web page in a browser of this machine can send requests here. A request is answered only if its
Host names this server and its Origin, if it has one, is this server's page. A command also needs
the token that the page gets with the scene, which a page of another origin cannot read.
"""

from __future__ import annotations

import hmac
import http.server
import io
import json
import math
import mimetypes
import pathlib
import secrets
import socket
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
LARGEST_CONNECTIONS = 64  # connections at the same time; an open page has up to seven
REQUEST_TIMEOUT = (
    10.0  # s of wall time for a whole request to arrive, and for an answer to be taken
)
TOKEN_HEADER = "X-Vtff-Token"

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
    # Connections beyond the queue of the kernel are not refused but tried again for many seconds.
    request_queue_size = 2 * LARGEST_CONNECTIONS
    # A page that was just closed does not keep its port from the next server.
    allow_reuse_address = True
    request_timeout = REQUEST_TIMEOUT

    def __init__(
        self,
        scene: Callable[[], dict[str, Any]],
        news: News | None = None,
        command: Command | None = None,
        port: int = 0,
    ) -> None:
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise OSError(f"port {port}: {error.strerror}; choose another --port") from error
        self.scene = scene
        self.news = news
        self.command = command
        self.closing = threading.Event()
        self.token = secrets.token_urlsafe(32)
        self._free_connections = threading.BoundedSemaphore(LARGEST_CONNECTIONS)

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server_address[1]}/"

    @property
    def hosts(self) -> tuple[str, str]:
        """Names with port under which a request may address this server."""
        port = self.server_address[1]
        return f"{HOST}:{port}", f"localhost:{port}"

    def start(self) -> None:
        """Serve in a thread until `stop`."""
        threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True).start()

    def stop(self) -> None:
        """End the server and its open pages."""
        self.closing.set()
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread; close it if there are too many."""
        if not self._free_connections.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no thread can be started
            self._free_connections.release()
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer the requests of one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free_connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Stay silent: a page that is closed breaks its connections."""


class _DeadlineReader(io.RawIOBase):
    """Reads a connection until a deadline, however often the client sends a few bytes.

    Parameters
    ----------
    connection
        Connection to read.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self.deadline = math.inf  # of time.monotonic(), s

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Read what has arrived; a TimeoutError at the deadline."""
        remaining = self.deadline - time.monotonic()
        if remaining <= 0.0:
            raise TimeoutError("the request did not arrive in time")
        self._connection.settimeout(remaining)
        return self._connection.recv_into(buffer)


class _Handler(http.server.BaseHTTPRequestHandler):
    """Answers one request."""

    server: ViewerServer
    protocol_version = "HTTP/1.1"

    def setup(self) -> None:
        """Read the connection with a deadline for each request."""
        super().setup()
        self._reader = _DeadlineReader(self.connection)
        self.rfile = io.BufferedReader(self._reader)

    def handle_one_request(self) -> None:
        """Answer one request, which arrives before its deadline."""
        self._reader.deadline = time.monotonic() + self.server.request_timeout
        super().handle_one_request()

    def do_GET(self) -> None:
        """Answer with the scene, its news, or a file of the page."""
        try:
            path = urllib.parse.unquote(urllib.parse.urlsplit(self.path).path)
        except ValueError:
            self.send_error(http.HTTPStatus.BAD_REQUEST)
            return
        if not self._is_of_this_page():
            self.send_error(http.HTTPStatus.FORBIDDEN)
        elif path == "/scene.json":
            shown = {"cesium": cesium_is_installed(), "command_token": self.server.token}
            self._send_json({**self.server.scene(), **shown})
        elif path == "/news" and self.server.news is not None:
            self._send_news(self.server.news)
        else:
            self._send_file(path)

    def do_POST(self) -> None:
        """Hand a command to the replay."""
        token = self.headers.get(TOKEN_HEADER, "").encode()
        if (
            not self._is_of_this_page()
            or self.path != "/command"
            or self.server.command is None
            or not hmac.compare_digest(token, self.server.token.encode())
        ):
            self.send_error(http.HTTPStatus.FORBIDDEN)
            return
        length = self._command_length()
        if length is None:
            return
        try:
            body = self.rfile.read(length)
        except TimeoutError:
            self.send_error(http.HTTPStatus.REQUEST_TIMEOUT)
            return
        try:
            request = json.loads(body)
            value = float(request.get("value", 0.0))
            if not math.isfinite(value):
                raise ValueError("the value of a command is a finite number")
            answer = self.server.command(str(request["command"]), value)
        except RecursionError:
            self.send_error(http.HTTPStatus.BAD_REQUEST, "the command is nested too deeply")
        except (AttributeError, LookupError, OverflowError, TypeError, ValueError) as error:
            self.send_error(http.HTTPStatus.BAD_REQUEST, _as_reason(error))
        else:
            self._send_json({"message": answer})

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Send an error and close the connection; a client that went is no concern."""
        self.connection.settimeout(self.server.request_timeout)
        super().send_error(code, message, explain)
        self.close_connection = True

    def log_message(self, format: str, *arguments: Any) -> None:
        """Stay silent: the terminal is the user's."""

    def _is_of_this_page(self) -> bool:
        """Return whether a request is for this server and from its page, or from no page.

        The Host is checked because a site may resolve its own name to this machine.
        """
        origin = self.headers.get("Origin")
        return self.headers.get("Host") in self.server.hosts and (
            origin is None or origin in [f"http://{host}" for host in self.server.hosts]
        )

    def _command_length(self) -> int | None:
        """Return the length of a command in bytes; if it is none, send the error."""
        lengths = self.headers.get_all("Content-Length", [])
        if not lengths or "Transfer-Encoding" in self.headers:
            self.send_error(http.HTTPStatus.LENGTH_REQUIRED)
            return None
        if len(lengths) > 1 or not (lengths[0].isascii() and lengths[0].isdigit()):
            self.send_error(http.HTTPStatus.BAD_REQUEST, "Content-Length is not a number of bytes")
            return None
        # A text longer than any allowed number is not turned into a number.
        if len(lengths[0]) > len(str(LARGEST_COMMAND)) or int(lengths[0]) > LARGEST_COMMAND:
            self.send_error(http.HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
            return None
        return int(lengths[0])

    def _send_json(self, content: dict[str, Any]) -> None:
        body = json.dumps(content, allow_nan=False, separators=(",", ":")).encode()
        self.send_response(http.HTTPStatus.OK)
        self.send_header("Cache-Control", "no-store")
        self._send_body("application/json", body)

    def _send_file(self, path: str) -> None:
        try:
            file = (WEB_FOLDER / (path.lstrip("/") or "index.html")).resolve()
            is_of_the_page = file.is_relative_to(WEB_FOLDER) and file.is_file()
        except (OSError, ValueError):  # no file can have that name
            is_of_the_page = False
        if not is_of_the_page:
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
        self.connection.settimeout(self.server.request_timeout)
        self.wfile.write(body)

    def _send_news(self, news: News) -> None:
        """Send server-sent events until the page or the server closes."""
        self.send_response(http.HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        self.connection.settimeout(self.server.request_timeout)
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


def _as_reason(error: Exception) -> str:
    """Return an error as the reason in a status line: short, printable ASCII."""
    text = str(error)[:200].encode("ascii", "replace").decode()
    return "".join(character if character.isprintable() else "?" for character in text)
