"""The web server of the viewer: what it serves, and what it refuses."""

import http.client
import json
import pathlib
import re
import resource
import socket
import threading

import pytest

from vtff_analysis.view.scene import Scene
from vtff_analysis.view.server import (
    LARGEST_COMMAND,
    LARGEST_CONNECTIONS,
    REQUEST_TIMEOUT,
    TOKEN_HEADER,
    WEB_FOLDER,
    ViewerServer,
)

SECOND = 10**9


@pytest.fixture
def server():
    scene = Scene("run", SECOND)
    for second in range(2000):
        scene.add("link", (1 + second) * SECOND, [40.0], craft="chief", satellite="G05")
    told = []

    def news(sent):
        return scene.as_json(sent), scene.counts()

    def command(name, value):
        if name != "seek":
            raise ValueError(f"unknown command '{name}'")
        told.append((name, value))
        return f"at {value:g} s"

    running = ViewerServer(scene.as_json, news, command)
    running.told = told
    running.start()
    yield running
    running.stop()


def ask(server, path, method="GET", body=None, **headers):
    connection = http.client.HTTPConnection(*server.server_address, timeout=20)
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer, content


def test_the_scene_is_sent_whole(server):
    answer, content = ask(server, "/scene.json")
    assert answer.status == 200
    scene = json.loads(content)
    assert scene["name"] == "run" and len(scene["series"][0]["time"]) == 2000
    assert isinstance(scene["cesium"], bool)


def test_every_file_that_the_page_names_is_served_from_here(server):
    answer, page = ask(server, "/")
    assert answer.status == 200 and b"<canvas" in page
    assert "default-src 'self'" in answer.getheader("Content-Security-Policy")
    for name in re.findall(r'(?:src|href)="([^":]+)"', page.decode()):
        assert ask(server, f"/{name}")[0].status == 200, name
    own = [path for path in WEB_FOLDER.iterdir() if path.suffix in (".js", ".css", ".html")]
    assert len(own) >= 8
    for path in own:
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"""(https?:)?//[a-z0-9-]+\.[a-z]""", text), path.name
        for module in re.findall(r'from "\./([^"]+)"', text):
            assert ask(server, f"/{module}")[0].status == 200, module


@pytest.mark.parametrize(
    "path",
    ["/../server.py", "/%2e%2e/server.py", "/nothing.js", "//etc/passwd", "/%00", "/" + "x" * 5000],
)
def test_nothing_else_is_served(server, path):
    assert ask(server, path)[0].status == 404


def command(server, body, **headers):
    """Send a command as the page does; `headers` replace those of the page, None leaves out."""
    page = {TOKEN_HEADER: server.token, "Origin": server.address.rstrip("/"), **headers}
    kept = {name: value for name, value in page.items() if value is not None}
    return ask(server, "/command", "POST", body, **kept)


SEEK = json.dumps({"command": "seek", "value": 3})


def test_pages_of_other_sites_are_refused(server):
    assert ask(server, "/scene.json", Host="elsewhere.example")[0].status == 403
    assert command(server, SEEK, Host="elsewhere.example")[0].status == 403
    for origin in ("http://elsewhere.example", "null", "", f"https://{server.hosts[0]}"):
        assert command(server, SEEK, Origin=origin)[0].status == 403, origin
        for path in ("/scene.json", "/news", "/"):
            assert ask(server, path, Origin=origin)[0].status == 403, (path, origin)
    # The page of another server of this machine.
    assert command(server, SEEK, Origin="http://127.0.0.1:1")[0].status == 403
    # Browsers ask this before they send a header of another origin's page.
    answer, _ = ask(server, "/command", "OPTIONS", Origin="http://elsewhere.example")
    assert answer.status == 501
    assert answer.getheader("Access-Control-Allow-Origin") is None
    assert server.told == []


def test_a_command_needs_the_token_of_the_page(server):
    for token in (None, "", "0" * len(server.token), server.token[:-1], "\xe9"):
        assert command(server, SEEK, **{TOKEN_HEADER: token})[0].status == 403, token
    assert server.told == []
    token = json.loads(ask(server, "/scene.json")[1])["command_token"]
    assert command(server, SEEK, **{TOKEN_HEADER: token})[0].status == 200
    assert server.told == [("seek", 3.0)]


def test_commands_reach_the_replay_and_wrong_ones_are_named(server):
    answer, content = command(server, SEEK)
    assert (answer.status, json.loads(content)) == (200, {"message": "at 3 s"})
    assert server.told == [("seek", 3.0)]
    answer, _ = command(server, SEEK, Origin=f"http://{server.hosts[1]}", Host=server.hosts[1])
    assert answer.status == 200  # localhost is this machine, too
    answer, _ = command(server, json.dumps({"command": "fly"}))
    assert (answer.status, answer.reason) == (400, "unknown command 'fly'")
    for wrong in ("", "[]", "{}", "1", "nonsense", "[" * 4000, b"\xff\xfe"):
        assert command(server, wrong)[0].status == 400, wrong
    for value in ("NaN", "Infinity", "1e999", "9" * 400, "null", '"x"'):
        wrong = f'{{"command": "seek", "value": {value}}}'
        assert command(server, wrong)[0].status == 400, value
    assert len(server.told) == 2


def test_a_command_cannot_write_headers_of_the_answer(server):
    answer, _ = command(server, json.dumps({"command": "x\r\nSet-Cookie: a=\u00e9"}))
    assert answer.status == 400
    assert answer.reason == "unknown command 'x??Set-Cookie: a=?'"
    assert answer.getheader("Set-Cookie") is None


def exchange(server, head, body=b"", timeout=20):
    """Send bytes as they are, and return the status of the answer; None if there is none."""
    with socket.create_connection(server.server_address, timeout) as connection:
        connection.sendall(head.encode() + body)
        answer = b""
        while content := connection.recv(65536):
            answer += content
    # A request without a version gets the text of an answer without its head.
    return int(answer.split()[1]) if answer.startswith(b"HTTP/") else None


def head(server, *lines):
    return "\r\n".join(
        (
            "POST /command HTTP/1.1",
            f"Host: {server.hosts[0]}",
            f"{TOKEN_HEADER}: {server.token}",
            *lines,
            "",
            "",
        )
    )


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        ([], 411),
        (["Transfer-Encoding: chunked"], 411),
        (["Content-Length: 3", "Transfer-Encoding: chunked"], 411),
        (["Content-Length: -1"], 400),
        (["Content-Length: +3"], 400),
        (["Content-Length: "], 400),
        (["Content-Length: 1e3"], 400),
        (["Content-Length: \u0663"], 400),
        (["Content-Length: 2", "Content-Length: 3"], 400),
        ([f"Content-Length: {LARGEST_COMMAND + 1}"], 413),
        (["Content-Length: 1000000000000"], 413),
        (["Content-Length: " + "9" * 5000], 413),
        (["Content-Length: 0"], 400),
    ],
)
def test_the_length_of_a_command_is_checked_before_it_is_read(server, lines, status):
    # Nothing follows the headers: an answer comes only if the server waits for no more.
    assert exchange(server, head(server, *lines)) == status
    assert server.told == []


def test_a_large_body_is_not_read(server):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with socket.create_connection(server.server_address, 20) as connection:
        connection.sendall(head(server, "Content-Length: 4000000000").encode())
        with pytest.raises(OSError):  # the server closes the connection
            for _ in range(4000):
                connection.sendall(bytes(100_000))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB
    assert ask(server, "/")[0].status == 200


def test_a_slow_client_is_left(server):
    assert REQUEST_TIMEOUT <= 30.0
    server.request_timeout = 0.2
    # Neither the headers nor the body come to an end.
    assert exchange(server, head(server)[:-2]) is None
    assert exchange(server, head(server, "Content-Length: 100"), b"{") == 408
    # A byte now and then does not extend the time.
    with socket.create_connection(server.server_address, 20) as connection:
        connection.settimeout(0.02)
        for _ in range(1000):
            try:
                connection.sendall(b"G")
                if not connection.recv(1):
                    break
            except TimeoutError:
                continue
            except OSError:
                break
        else:
            pytest.fail("the server waits for ever")
    assert server.told == []


def test_a_client_that_takes_no_answer_is_left(server):
    server.request_timeout = 0.2
    large = {"name": "x" * 20_000_000}
    server.scene = lambda: large
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(server.server_address)
        connection.sendall(f"GET /scene.json HTTP/1.1\r\nHost: {server.hosts[0]}\r\n\r\n".encode())
        for thread in threading.enumerate():
            if "process_request_thread" in thread.name:
                while thread.ident is None:  # it is in the list before it has started
                    threading.Event().wait(0.01)
                thread.join(20.0)
                assert not thread.is_alive()


def test_connections_without_number_are_closed(server):
    server.request_timeout = 60.0
    connections = [
        socket.create_connection(server.server_address, 20) for _ in range(LARGEST_CONNECTIONS)
    ]
    with socket.create_connection(server.server_address, 20) as another:
        assert another.recv(1) == b""
    for connection in connections:
        connection.close()
    for _ in range(100):  # closed connections are noticed by their threads
        try:
            if ask(server, "/")[0].status == 200:
                break
        except OSError:
            threading.Event().wait(0.05)
    else:
        pytest.fail("the server answers nobody any more")


@pytest.mark.parametrize(
    "text", ["\r\n", "nonsense\r\n\r\n", "GET / HTTP/9\r\n\r\n", "\0" * 99_999]
)
def test_nonsense_ends_nothing(server, text):
    server.request_timeout = 0.2
    assert exchange(server, text) in (None, 400, 414, 505)
    assert ask(server, "/")[0].status == 200


def test_news_come_as_events(server):
    connection = http.client.HTTPConnection(*server.server_address, timeout=20)
    connection.request("GET", "/news")
    answer = connection.getresponse()
    assert answer.getheader("Content-Type") == "text/event-stream"
    line = answer.readline().decode()
    assert line.startswith("data: ")
    assert len(json.loads(line.removeprefix("data: "))["series"][0]["time"]) == 2000
    assert answer.readline() == b"\n"
    later = json.loads(answer.readline().decode().removeprefix("data: "))
    assert later["series"] == []
    connection.close()


def test_a_taken_port_is_an_error(server):
    with pytest.raises(OSError, match=r"port \d+: .* in use; choose another"):
        ViewerServer(dict, port=server.server_address[1])


def test_cesium_is_no_part_of_the_repository():
    ignored = (WEB_FOLDER / ".gitignore").read_text()
    assert "/cesium/" in ignored
    assert pathlib.Path(WEB_FOLDER, "index.html").is_file()
