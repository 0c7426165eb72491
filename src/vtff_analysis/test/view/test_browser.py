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

from vtff_analysis.page.page import Picture, render_figures, render_page  # noqa: E402
from vtff_analysis.plot_style import make_figure, save_figure  # noqa: E402
from vtff_analysis.report import write_report  # noqa: E402
from vtff_analysis.view.bag_scene import read_scene  # noqa: E402
from vtff_analysis.view.page_file import write_page  # noqa: E402
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


REGION = {
    "name": "bubble",
    "latitude_south_deg": -10.0,
    "latitude_north_deg": 10.0,
    "longitude_west_deg": -60.0,
    "width_deg": 5.0,
    "longitude_rate_deg": 0.0,
    "altitude_bottom": 250e3,
    "altitude_top": 600e3,
    "s4": 0.5,
}


@pytest.mark.skipif(not cesium_is_installed(), reason="needs Cesium: tools/install_viewer.sh")
@pytest.mark.parametrize("regions", [[], [REGION]], ids=["without", "with"])
def test_the_camera_of_a_region_is_offered_where_there_is_one(browser, scene, regions):
    for visit in viewed(browser, {**scene, "regions": regions}):
        button = visit.page.locator('[data-camera="region"]')
        assert button.is_visible() == bool(regions)
        visit.page.keyboard.press("5")
        assert visit.value("window.vtff.camera") == ("region" if regions else "earth")
        assert visit.errors == []


def test_map_without_cesium(visit_without_cesium):
    visit = visit_without_cesium
    check_spacecraft_links_and_plots(visit)
    assert visit.value("window.vtff.globe.constructor.name") == "GroundMap"
    assert visit.page.get_by_role("status").inner_text().startswith("map instead of globe")
    assert visit.colours("#map") > 50


def test_many_spacecraft_are_drawn_on_the_map(browser, scene, monkeypatch):
    """From the seventh on the map stopped at a circle of negative radius."""
    monkeypatch.setattr("vtff_analysis.view.server.cesium_is_installed", lambda: False)
    (orbit,) = [part for part in scene["series"] if part["name"] == "orbit/deputy/truth"]
    names = [f"deputy_{number}" for number in range(2, 10)]
    more = [{**orbit, "name": f"orbit/{name}/truth", "craft": name} for name in names]
    for visit in viewed(browser, {**scene, "series": [*scene["series"], *more]}):
        visit.wait("window.vtff.drawn === 0")
        assert visit.value("window.vtff.globe.counts.spacecraft") == 10
        assert visit.errors == []


def test_labels_cover_no_other_and_stay_within_the_pane(visit_without_cesium):
    label = "{ left: 380, top: 90, wide: 60, high: 20 }"
    places = visit_without_cesium.value(
        f"import('/canvas.js').then((m) => m.placeLabels([{label}, {label}, {label}], 400, 300))"
    )
    assert [place["left"] for place in places] == [336] * 3
    assert [place["top"] for place in places] == [90, 110, 130]


def test_the_views_of_the_formation_stand_below_each_other_on_a_phone(visit_without_cesium):
    visit = visit_without_cesium
    corner = "window.vtff.hill.frames.map(({ frame }) => [frame.x, frame.y])"
    side, above = visit.value(corner)
    assert side[0] < above[0] and side[1] == above[1]
    visit.page.set_viewport_size({"width": 390, "height": 844})
    visit.value("window.vtff.timeline.seek(10)")
    visit.wait("window.vtff.drawn === 10")
    side, above = visit.value(corner)
    assert side[0] == above[0] and side[1] < above[1]


def test_controls_move_the_time(visit_without_cesium):
    visit = visit_without_cesium
    now = "window.vtff.timeline.time"
    assert visit.value(now) == 0
    visit.page.get_by_label("Speed").select_option("30")
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


def test_keys_work_wherever_the_focus_is(visit_without_cesium):
    visit = visit_without_cesium
    now = "window.vtff.timeline.time"
    for focused in ("#picture", "#scrub", "#speed", "#colour"):
        visit.page.focus(focused)
        visit.page.keyboard.press("Home")
        assert visit.value(now) == 0, focused
        visit.page.keyboard.press("ArrowRight")
        visit.page.keyboard.press("Shift+ArrowRight")
        assert visit.value(now) == 11, focused
        visit.page.keyboard.press(" ")
        visit.wait(f"{now} > 12")
        visit.page.keyboard.press(" ")
        assert visit.value("window.vtff.timeline.playing") is False, focused
    visit.page.keyboard.press("Home")
    events = visit.value("window.vtff.scene.events.map((event) => event.time)")
    visit.page.keyboard.press("n")
    assert visit.value(now) == min(time for time in events if time > 0.01)
    visit.page.keyboard.press("End")
    visit.page.keyboard.press("p")
    assert visit.value(now) == max(events)
    visit.page.keyboard.press("?")
    assert visit.page.get_by_role("dialog").is_visible()
    assert visit.errors == []


def test_marks_of_events_go_there(visit_without_cesium):
    visit = visit_without_cesium
    mark = visit.page.locator(".mark.manoeuvre").first
    assert "deputy: thrust for" in mark.get_attribute("title")
    mark.dispatch_event("click")
    assert visit.value("window.vtff.timeline.time") == 1


def test_plots_zoom_and_their_values_fit_what_is_shown(visit_without_cesium):
    visit = visit_without_cesium
    plot = visit.page.locator('[data-plot="relative/deputy/estimate"]')
    box = plot.bounding_box()
    middle = box["y"] + box["height"] / 2
    visit.wait("window.vtff.plots.plots[0].picture")
    whole = visit.value("window.vtff.plots.plots[0].picture.range")
    visit.page.mouse.move(box["x"] + 0.6 * box["width"], middle)
    visit.page.mouse.down()
    visit.page.mouse.move(box["x"] + 0.9 * box["width"], middle, steps=4)
    visit.page.mouse.up()
    visit.wait("window.vtff.plots.window && window.vtff.plots.plots[0].picture")
    shown = visit.value("window.vtff.plots.plots[0].picture.range")
    assert shown["x"][0] > 60 and shown["x"][1] < 140
    size = [limits["y"][1] - limits["y"][0] for limits in (whole, shown)]
    assert size[0] > 1000 and size[1] < 150  # the approach is out of view
    assert visit.value("window.vtff.timeline.time") == 0  # a drag is no click
    visit.page.mouse.wheel(0, -200)
    visit.wait("window.vtff.plots.plots[0].picture")
    closer = visit.value("window.vtff.plots.range")
    assert closer[1] - closer[0] < shown["x"][1] - shown["x"][0]
    plot.dblclick()
    assert visit.value("window.vtff.plots.window") is None
    visit.page.keyboard.press("+")
    assert visit.value("window.vtff.plots.window") is not None
    assert visit.errors == []


def test_the_formation_plane_zooms_about_the_pointer(visit_without_cesium):
    visit = visit_without_cesium
    visit.wait("window.vtff.hill.frames.length === 2")
    before = visit.value("window.vtff.hill.fit().scale")
    box = visit.page.locator("#hill").bounding_box()
    visit.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.4 * box["height"])
    visit.page.mouse.wheel(0, -100)
    assert visit.value("window.vtff.hill.fit().scale") < before
    visit.page.locator("#hill").dblclick()
    assert visit.value("window.vtff.hill.fit().scale") == before


def test_an_address_brings_the_view_back(browser, visit_without_cesium):
    visit = visit_without_cesium
    visit.value("window.vtff.timeline.seek(42.5)")
    visit.value("window.vtff.plots.show([30, 70])")
    visit.page.get_by_role("button", name="Link").click()
    again = Visit(browser, visit.page.url)
    again.wait("window.vtff && window.vtff.globe && window.vtff.timeline.time === 42.5")
    assert again.value("window.vtff.plots.window") == [30, 70]
    again.page.close()


def test_the_rate_that_is_shown_is_measured(visit_without_cesium):
    visit = visit_without_cesium
    visit.page.get_by_label("Speed").select_option("10")
    visit.page.keyboard.press(" ")
    visit.wait("document.getElementById('rate').textContent.startsWith('measured')")
    assert 0 < visit.value("window.vtff.timeline.trueRate") < 12


def test_pictures_and_videos_are_saved(visit_without_cesium):
    visit = visit_without_cesium
    with visit.page.expect_download() as download:
        visit.page.keyboard.press("s")
    picture = Image.open(download.value.path())
    assert picture.width == 1200 and len(picture.convert("RGB").getcolors(1 << 24)) > 500
    visit.page.get_by_role("button", name="Video").click()
    visit.page.keyboard.press(" ")
    visit.page.wait_for_timeout(700)
    with visit.page.expect_download() as download:
        visit.page.get_by_role("button", name="Video").click()
    assert pathlib.Path(download.value.path()).read_bytes()[:4] == b"\x1aE\xdf\xa3"  # Matroska
    assert download.value.suggested_filename == "sample.webm"


def test_a_second_run_is_shown_behind_the_first(browser):
    scene = read_scene(SAMPLE)
    scene.beside = read_scene(SAMPLE)
    scene.beside.name = "the other"
    for visit in viewed(browser, scene.as_json()):
        assert visit.page.locator("#name").inner_text() == "sample beside the other"
        assert visit.value("window.vtff.plots.plots[0].lines.filter((l) => l.beside).length") == 3
        assert "the other" in visit.page.locator("#legend").inner_text()
        assert visit.errors == []


@pytest.mark.skipif(not cesium_is_installed(), reason="needs Cesium: tools/install_viewer.sh")
def test_the_formation_is_drawn_close_up(visit):
    visit.value("window.vtff.timeline.seek(60)")
    visit.page.keyboard.press("4")
    visit.wait("window.vtff.globe.formation.deputies.get('deputy').length.text.startsWith('110.9')")
    deputy = "window.vtff.globe.formation.deputies.get('deputy')"
    assert visit.value(f"{deputy}.label.text").startswith("deputy\n3 sigma ")
    assert visit.value(f"{deputy}.arrow.show") and visit.value(f"{deputy}.ellipsoid.show")
    # The wheel and drags of the user stay when the time goes on.
    away = visit.value("window.vtff.globe.widget.scene.camera.position.x")
    visit.page.mouse.move(300, 300)
    visit.page.mouse.wheel(0, 300)
    visit.wait(f"window.vtff.globe.widget.scene.camera.position.x !== {away}")
    chosen = None
    while chosen != (chosen := visit.value("window.vtff.globe.widget.scene.camera.position.x")):
        visit.page.wait_for_timeout(1000)  # the zoom runs out slowly
    visit.value("window.vtff.timeline.seek(61)")
    visit.wait("window.vtff.drawn === 61")
    now = visit.value("window.vtff.globe.widget.scene.camera.position.x")
    assert now == pytest.approx(chosen, rel=1e-3)
    assert visit.errors == []


def check_close_view(visit):
    """The formation at 60 s on a plain canvas; a drag turns it, the wheel zooms."""
    close = "window.vtff.globe.close"
    visit.page.keyboard.press("4")
    visit.wait(f"{close}.labels?.length")
    texts = visit.value(f"{close}.labels.map((label) => label.text)")
    assert {"chief", "T", "N", "110.91 m"} < set(texts)
    assert any(text.startswith("deputy\n3 sigma ") for text in texts)
    assert visit.colours("#map") > 50
    # Right, up and to the viewer are a right-handed set, whatever the turn.
    box = visit.page.locator("#map").bounding_box()
    visit.page.mouse.move(box["x"] + 200, box["y"] + 200)
    visit.page.mouse.down()
    visit.page.mouse.move(box["x"] + 260, box["y"] + 240, steps=3)
    visit.page.mouse.up()
    far = visit.value(f"{close}.range")
    visit.page.mouse.wheel(0, -100)
    visit.wait(f"{close}.range < {far}")
    view = visit.value(f"[{close}.view.right, {close}.view.up, {close}.view.toViewer]")
    assert np.cross(view[0], view[1]) == pytest.approx(view[2])
    visit.page.locator("#map").dblclick()
    visit.wait(f"{close}.range === {far}")
    visit.page.keyboard.press("2")  # there is no globe with links
    assert visit.value("window.vtff.camera") == "formation"
    visit.page.keyboard.press("1")
    assert visit.value("window.vtff.camera") == "earth"


def test_an_exported_file_needs_nothing_else(browser, scene, tmp_path):
    write_page(scene, tmp_path / "run.html")
    visit = Visit(browser, (tmp_path / "run.html").as_uri())
    visit.wait("window.vtff && window.vtff.globe")
    visit.value("window.vtff.timeline.seek(60)")
    visit.wait("window.vtff.globe.counts.links >= 16")
    assert visit.page.get_by_role("status").inner_text() == ""
    assert visit.colours("#map") > 50 and visit.colours("#hill") > 20
    check_close_view(visit)
    assert visit.errors == []
    assert [url for url in visit.requests if not re.match("file:|data:", url)] == []
    assert len([url for url in visit.requests if url.startswith("file:")]) == 1
    visit.page.close()


def test_data_cannot_end_the_script_that_holds_it(browser, scene, tmp_path):
    name = "</script><script>window.broken = true;</script>"
    write_page({**scene, "name": name}, tmp_path / "run.html")
    visit = Visit(browser, (tmp_path / "run.html").as_uri())
    visit.wait("window.vtff && window.vtff.globe")
    assert visit.page.locator("#name").inner_text() == name
    assert visit.value("window.broken === undefined")
    visit.page.close()


@pytest.mark.parametrize("width", [1440, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_overlaps_or_is_cut(browser, scene, width, scheme, monkeypatch):
    monkeypatch.setattr("vtff_analysis.view.server.cesium_is_installed", lambda: False)
    server = ViewerServer(lambda: scene)
    server.start()
    try:
        page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
        page.goto(server.address)
        page.wait_for_selector(".mark")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        boxes = page.evaluate(
            "[...document.querySelectorAll('header > *, #tools > *, footer > *')]"
            ".filter((e) => e.checkVisibility() && e.getBoundingClientRect().width"
            " && !e.querySelector(':scope > button')).map((e) => [e.id || e.tagName,"
            " ...Object.values(e.getBoundingClientRect().toJSON()).slice(0, 4)])"
        )
        for number, (name, x, y, wide, high) in enumerate(boxes):
            assert x >= 0 and x + wide <= width + 0.5, name
            for other, left, top, across, down in boxes[number + 1 :]:
                apart = (
                    x + wide <= left + 0.5
                    or left + across <= x + 0.5
                    or y + high <= top + 0.5
                    or top + down <= y + 0.5
                )
                assert apart, (name, other)
        bar = page.evaluate("document.querySelector('footer').getBoundingClientRect().height")
        assert bar < 120  # the rest is for what is shown
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert background == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 24, 28)")
        page.close()
    finally:
        server.stop()


def grow(scene, seconds):
    """A live scene as the server sends it: what is new since the last news, by `seconds`."""
    whole = scene["series"]

    def upto(part, first, last):
        keep = [i for i, time in enumerate(part["time"]) if first < time <= last]
        return {
            name: [value[i] for i in keep] if isinstance(value, list) else value
            for name, value in part.items()
        }

    def news(first, last):
        series = [upto(part, first, last) for part in whole]
        series = [part for part in series if part["time"]]
        events = [event for event in scene["events"] if event["time"] <= last]
        return {**scene, "live": True, "duration": last, "events": events, "series": series}

    begin = time.monotonic()

    def now():
        return min(time.monotonic() - begin + 1.0, seconds)

    def later(sent):
        last = now()
        return news(sent.get("", -1.0), last), {"": last}

    return lambda: news(-1.0, 0.0), later


@pytest.mark.parametrize(
    "seconds", [4.0, pytest.param(120.0, marks=pytest.mark.slow)], ids=["short", "long"]
)
def test_a_live_run_is_followed(browser, scene, seconds, monkeypatch):
    monkeypatch.setattr("vtff_analysis.view.server.cesium_is_installed", lambda: False)
    first, news = grow(scene, seconds)
    server = ViewerServer(first, news, lambda name, value: "taken")
    server.start()
    try:
        visit = Visit(browser, server.address)
        visit.wait("window.vtff && window.vtff.globe")
        deadline = time.monotonic() + seconds + LIMIT
        while visit.value("window.vtff.timeline.time") < seconds:
            assert time.monotonic() < deadline
            assert visit.value("window.vtff.timeline.following")
            visit.page.wait_for_timeout(500)
        assert visit.value("window.vtff.scene.series.get('orbit/chief/truth').time.length") > 3
        visit.page.get_by_role("button", name="Play or pause").click()
        assert visit.value("window.vtff.timeline.following") is False
        visit.page.get_by_role("button", name="Live").click()
        assert visit.value("window.vtff.timeline.following") is True
        assert visit.errors == []
        visit.page.close()
    finally:
        server.stop()


def test_a_live_run_that_has_ended_is_drawn(browser, scene, monkeypatch):
    """All of it comes with the first news, in the first second of the page, and nothing after."""
    monkeypatch.setattr("vtff_analysis.view.server.cesium_is_installed", lambda: False)
    live = {**scene, "live": True}

    def news(sent):
        return {**live, "series": [] if sent else scene["series"]}, {"": 1}

    server = ViewerServer(lambda: {**live, "series": []}, news, lambda name, value: "taken")
    server.start()
    try:
        visit = Visit(browser, server.address)
        visit.wait("document.querySelectorAll('#plots canvas').length >= 3")
        assert visit.colours("#hill") > 20 and visit.errors == []
        visit.page.close()
    finally:
        server.stop()


def test_ionosphere_is_shown(browser, tmp_path):
    content = read_scene(write_full_run(tmp_path / "bag", seconds=130)).as_json()
    for visit in viewed(browser, content):
        plots = visit.value(
            "[...document.querySelectorAll('#plots canvas')].map((c) => c.dataset.plot)"
        )
        assert {"pierce/deputy", "scintillation/deputy"} < set(plots)
        assert visit.errors == []


def test_an_axis_that_is_logarithmic_on_both_sides_and_many_names(browser, tmp_path):
    """Its title said so, and it was drawn linear with ticks over each other."""
    figure = make_figure(3.0)
    axes = figure.subplots()
    axes.plot([0.0, 1.0, 2.0], [-40.0, 0.5, 900.0])
    for number in range(12):
        axes.plot([0.0, 2.0], [0.0, 0.0], label=f"a line with a name, {number}")
    axes.set_yscale("symlog", linthresh=1.0, linscale=1.5)
    picture = Picture(save_figure(figure, tmp_path / "a.png", "both sides"), "caption", "a")
    (tmp_path / "a.html").write_text(render_page("a", "", render_figures([picture], "a")))
    visit = Visit(browser, (tmp_path / "a.html").as_uri())
    panel = "document.querySelector('figure').panels[0]"
    visit.wait(f"{panel}.drawn")
    for value in (-40.0, -1.0, -0.3, 0.0, 0.7, 900.0):
        assert visit.value(f"{panel}.unscaled({panel}.scaled({value}, 1), 1)") == pytest.approx(
            value
        )
    # As in the picture of matplotlib, to its margins.
    low, high = visit.value(f"{panel}.drawn.y")
    drawn_at = [visit.value(f"{panel}.scaled({value}, 1)") for value in (-1.0, 0.0, 1.0, 100.0)]
    assert np.diff(drawn_at) == pytest.approx([1.5 / 0.9, 1.5 / 0.9, 2.0])
    assert low < drawn_at[0] and drawn_at[3] < high
    ticks = visit.value(f"{panel}.symmetricTicks({panel}.drawn.y, 200)").get("ticks")
    assert np.diff(sorted(ticks)).min() * 200 / (high - low) >= 15.0
    assert drawn_at[3] in [pytest.approx(tick) for tick in ticks]
    visit.page.set_viewport_size({"width": 390, "height": 844})
    visit.wait(f"{panel}.canvas.clientHeight > 350")  # the names are above the lines
    frame = visit.value(f"{panel}.drawn.frame")
    assert frame["height"] > 150 and visit.errors == []
    visit.page.close()


def test_report_opens_without_errors_and_with_every_figure(browser, tmp_path):
    bag = write_full_run(tmp_path / "recorded", seconds=130)
    folder = write_report(bag, Console(file=io.StringIO()), output=tmp_path / "report")
    visit = Visit(browser, (folder / "report.html").as_uri())
    pictures = visit.value(
        "[...document.images].map((i) => [i.complete, i.naturalWidth, i.clientWidth, i.alt])"
    )
    assert len(pictures) == len(list(folder.glob("*.png"))) >= 9
    for complete, width, shown, name in pictures:
        assert complete and width > 1000 and name
        assert shown > 300 or visit.value("document.querySelectorAll('.panels').length")
    # Figures of lines can be zoomed; the others stay pictures.
    figures = visit.value("document.querySelectorAll('figure').length")
    assert 5 <= visit.value("document.querySelectorAll('.panels').length") < figures
    panel = "document.querySelector('[data-name=relative_position]').panels[0]"
    whole = visit.value(f"{panel}.drawn")
    canvas = visit.page.locator("[data-name=relative_position] canvas").first
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    visit.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 100)
    visit.page.mouse.down()
    visit.page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 100, steps=3)
    visit.page.mouse.up()
    closer = visit.value(f"{panel}.drawn")
    assert whole["x"][0] < closer["x"][0] < closer["x"][1] < whole["x"][1]
    others = "document.querySelector('[data-name=relative_position]').panels[2].drawn"
    assert visit.value(others)["x"] == closer["x"]  # panels of one time zoom together
    canvas.dblclick()
    assert visit.value(f"{panel}.drawn") == whole
    visit.page.set_viewport_size({"width": 390, "height": 844})
    assert visit.value("document.documentElement.scrollWidth") <= 390
    assert visit.errors == []
    assert [url for url in visit.requests if not re.match("file:|data:", url)] == []
    visit.page.close()
