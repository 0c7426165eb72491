"""Viewer and report in headless Chromium: what is drawn, what moves, and that nobody is asked."""

import io
import pathlib
import re
import shutil
import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("needs Chromium (Debian: apt install chromium)", allow_module_level=True)
playwright = pytest.importorskip(
    "playwright.sync_api", reason="needs playwright: pip install playwright"
)

import numpy as np  # noqa: E402
from full_run_samples import write_full_run  # noqa: E402
from PIL import Image  # noqa: E402
from rich.console import Console  # noqa: E402

from vtff_analysis.report import write_report  # noqa: E402
from vtff_analysis.view.bag_scene import read_scene  # noqa: E402
from vtff_analysis.view.server import ViewerServer, cesium_is_installed  # noqa: E402

SAMPLE = pathlib.Path(__file__).resolve().parents[4] / "bags/sample"
LIMIT = 60.0  # s of wall time for what needs no more than a few
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
).split()


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        running = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


class Visit:
    """A page with all that it asked for and all that went wrong on it."""

    def __init__(self, browser, address):
        self.page = browser.new_page(viewport={"width": 1200, "height": 760})
        self.requests, self.errors = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on(
            "console",
            lambda said: self.errors.append(said.text) if said.type == "error" else None,
        )
        self.page.goto(address)

    def value(self, expression):
        return self.page.evaluate(expression)

    def wait(self, expression):
        """Wait until an expression is true; the page's policy forbids wait_for_function."""
        deadline = time.monotonic() + LIMIT
        while not self.value(f"Boolean({expression})"):
            assert time.monotonic() < deadline, f"{expression} did not become true"
            self.page.wait_for_timeout(50)

    def colours(self, selector):
        """Return how many colours a part of the page shows."""
        picture = Image.open(io.BytesIO(self.page.locator(selector).screenshot()))
        return len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0))


def viewed(browser, content):
    server = ViewerServer(lambda: content)
    server.start()
    try:
        visit = Visit(browser, server.address)
        visit.address = server.address
        visit.wait("window.vtff && window.vtff.globe")
        yield visit
        visit.page.close()
    finally:
        server.stop()


@pytest.fixture(scope="module")
def scene():
    return read_scene(SAMPLE).as_json()


@pytest.fixture
def visit(browser, scene):
    yield from viewed(browser, scene)


@pytest.fixture
def visit_without_cesium(browser, scene, monkeypatch):
    monkeypatch.setattr("vtff_analysis.view.server.cesium_is_installed", lambda: False)
    yield from viewed(browser, scene)


def check_spacecraft_links_and_plots(visit):
    visit.page.get_by_label("Time").evaluate(
        "e => { e.value = 60; e.dispatchEvent(new Event('input')); }"
    )
    visit.wait("window.vtff.drawn === 60")
    visit.wait("window.vtff.globe.counts.links >= 16")  # at least 8 for each
    assert visit.value("window.vtff.globe.counts.spacecraft") == 2
    plots = visit.value(
        "[...document.querySelectorAll('#plots canvas')].map((c) => c.dataset.plot)"
    )
    assert {"relative/deputy/estimate", "error/deputy", "thrust/deputy/applied"} < set(plots)
    for plot in plots:
        assert visit.colours(f'[data-plot="{plot}"]') > 20, plot
    assert visit.colours("#hill") > 20
    assert visit.errors == []
    assert [url for url in visit.requests if not url.startswith(visit.address)] == []


@pytest.mark.skipif(not cesium_is_installed(), reason="needs Cesium: tools/install_viewer.sh")
def test_globe(visit):
    check_spacecraft_links_and_plots(visit)
    assert visit.value("window.vtff.globe.constructor.name") == "Globe"
    visit.wait("window.vtff.globe.widget.scene.globe.tilesLoaded")
    visit.page.wait_for_timeout(500)
    assert visit.colours("#globe") > 1000  # the Earth; an empty sky has a few dozen
    for camera in ("chief", "earth"):
        visit.page.click(f'[data-camera="{camera}"]')
        visit.page.wait_for_timeout(200)
    assert visit.errors == []


def test_map_without_cesium(visit_without_cesium):
    visit = visit_without_cesium
    check_spacecraft_links_and_plots(visit)
    assert visit.value("window.vtff.globe.constructor.name") == "GroundMap"
    assert visit.page.get_by_role("status").inner_text().startswith("map instead of globe")
    assert visit.colours("#map") > 50


def test_controls_move_the_time(visit_without_cesium):
    visit = visit_without_cesium
    now = "window.vtff.timeline.time"
    assert visit.value(now) == 0
    visit.page.get_by_label("Speed").select_option("200")
    visit.page.get_by_role("button", name="Play or pause").click()
    visit.wait(f"{now} > 20")
    assert visit.page.locator("#utc").inner_text().startswith("2016-03-21 0")
    visit.page.get_by_role("button", name="Play or pause").click()
    stopped = visit.value(now)
    visit.page.wait_for_timeout(300)
    assert visit.value(now) == stopped
    visit.page.get_by_label("Time").evaluate(
        "e => { e.value = 75; e.dispatchEvent(new Event('input')); }"
    )
    assert visit.value(now) == 75
    visit.page.locator("#hill").click()
    visit.page.keyboard.press("ArrowRight")
    assert visit.value(now) == 85
    plot = visit.page.locator("#plots canvas").first
    plot.click(position={"x": 300, "y": 60})
    assert 0 < visit.value(now) < 141 and visit.value(now) != 85
    visit.page.keyboard.press(" ")
    visit.wait(f"{now} === window.vtff.scene.duration")
    visit.wait("!window.vtff.timeline.playing")  # it stops at the end


def test_ionosphere_is_shown(browser, tmp_path):
    content = read_scene(write_full_run(tmp_path / "bag", seconds=130)).as_json()
    for visit in viewed(browser, content):
        plots = visit.value(
            "[...document.querySelectorAll('#plots canvas')].map((c) => c.dataset.plot)"
        )
        assert {"pierce/deputy", "scintillation/deputy"} < set(plots)
        assert visit.errors == []


def test_report_opens_without_errors_and_with_every_figure(browser, tmp_path):
    bag = write_full_run(tmp_path / "recorded", seconds=130)
    folder = write_report(bag, Console(file=io.StringIO()), output=tmp_path / "report")
    visit = Visit(browser, (folder / "report.html").as_uri())
    pictures = visit.value(
        "[...document.images].map((i) => [i.complete, i.naturalWidth, i.clientWidth, i.alt])"
    )
    assert len(pictures) == len(list(folder.glob("*.png"))) >= 9
    for complete, width, shown, name in pictures:
        assert complete and width > 1000 and shown > 300 and name
    assert visit.errors == []
    assert [url for url in visit.requests if not re.match("file:|data:", url)] == []
    visit.page.close()
