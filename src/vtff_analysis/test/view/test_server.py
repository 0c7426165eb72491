"""The web server of the viewer: what it serves, and what it refuses."""

import http.client
import json
import pathlib
import re

import pytest

from vtff_analysis.view.scene import Scene
from vtff_analysis.view.server import WEB_FOLDER, ViewerServer

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
    "path", ["/../server.py", "/%2e%2e/server.py", "/nothing.js", "//etc/passwd"]
)
def test_nothing_else_is_served(server, path):
    assert ask(server, path)[0].status == 404


def test_pages_of_other_sites_are_refused(server):
    assert ask(server, "/scene.json", Host="elsewhere.example")[0].status == 403
    body = json.dumps({"command": "seek", "value": 3})
    assert ask(server, "/command", "POST", body, Host="elsewhere.example")[0].status == 403
    assert server.told == []


def test_commands_reach_the_replay_and_wrong_ones_are_named(server):
    answer, content = ask(server, "/command", "POST", json.dumps({"command": "seek", "value": 3}))
    assert (answer.status, json.loads(content)) == (200, {"message": "at 3 s"})
    assert server.told == [("seek", 3.0)]
    answer, _ = ask(server, "/command", "POST", json.dumps({"command": "fly"}))
    assert (answer.status, answer.reason) == (400, "unknown command 'fly'")
    for wrong in ("", "[]", "{}", "nonsense"):
        assert ask(server, "/command", "POST", wrong)[0].status == 400


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
    with pytest.raises(OSError, match="in use"):
        ViewerServer(dict, port=server.server_address[1])


def test_cesium_is_no_part_of_the_repository():
    ignored = (WEB_FOLDER / ".gitignore").read_text()
    assert "/cesium/" in ignored
    assert pathlib.Path(WEB_FOLDER, "index.html").is_file()
