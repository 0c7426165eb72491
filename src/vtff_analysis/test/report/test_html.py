"""The HTML report: one file that needs nothing else, with every part that a run has."""

import html.parser
import io
import json
import re
import shutil
import subprocess

import pytest
from rich.console import Console

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

import full_run_samples  # noqa: E402

from vtff_analysis.evaluation.navigation import navigation_error  # noqa: E402
from vtff_analysis.recordings.recording import read_run  # noqa: E402
from vtff_analysis.recordings.run_place import find_run  # noqa: E402
from vtff_analysis.report import write_report  # noqa: E402
from vtff_bag.run.description import (  # noqa: E402
    RunDescription,
    describe_run_folder,
    write_arguments,
)

SCENARIO = "name: reference\nseed: 77\n"
PARAMETERS = (
    "/sdre_controller:\n  ros__parameters:\n    deputy: deputy\n    design: paper\n"
    "    target_position_rtn: [0.0, 100.0, 0.0]\n    acceleration_cap: 0.5\n"
)


def texts_of_run(scenario_file):
    bridge = f"/simgen_bridge:\n  ros__parameters:\n    scenario_file: {scenario_file}\n"
    return {"sdre_controller": PARAMETERS, "simgen_bridge": bridge}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag alone: no run folder around it, everything known is in its metadata."""
    folder = tmp_path_factory.mktemp("html")
    described = RunDescription(
        arguments={"system": "test_system", "gnss": "<none>"},
        environment={"vtff_version": "9.8.7", "git_commit": "c0ffee" * 7, "git_modified": False},
        parameter_texts=texts_of_run("/not/here.yaml"),
        scenario_text=SCENARIO,
    )
    full_run_samples.write_full_run(folder / "recorded", custom=described.as_custom_data())
    return folder / "recorded"


@pytest.fixture(scope="module")
def page(bag, tmp_path_factory):
    output = tmp_path_factory.mktemp("report") / "out"
    write_report(bag, Console(file=io.StringIO()), output=output)
    return output / "report.html"


class Structure(html.parser.HTMLParser):
    """Checks nesting and collects headings, pictures and references."""

    VOID = {"meta", "link", "img", "br", "wbr"}

    def __init__(self):
        super().__init__()
        self.open, self.sections, self.pictures, self.references = [], [], [], []
        self.in_heading = False

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.references += [values[key] for key in ("src", "href") if key in values]
        if tag == "img":
            self.pictures.append(values["alt"])
        if tag not in self.VOID:
            self.open.append(tag)
        self.in_heading = tag == "h2"

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        self.in_heading = False

    def handle_data(self, text):
        if self.in_heading:
            self.sections.append(text)


def structure(page):
    found = Structure()
    found.feed(page.read_text(encoding="utf-8"))
    assert found.open == []
    return found


def test_every_part_is_there_and_nothing_is_fetched(page):
    found = structure(page)
    assert found.sections == [
        *("Formation", "Navigation", "Ionosphere", "GNSS", "Health", "Timing"),
        *("How it was run", "Parameters", "Recorded topics"),
    ]
    # A DOI is a link to click on, and nothing that the page loads.
    assert all(text.startswith(("data:", "#", "https://doi.org/")) for text in found.references)
    assert len(found.pictures) == len(list(page.parent.glob("*.png"))) >= 9
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"url\(|@import |<script[^>]* src|<link[^>]*http", text)


def test_it_says_what_was_run_and_what_was_wrong(page):
    text = page.read_text(encoding="utf-8").replace("<wbr>", "")
    for said in (
        *("test_system", "9.8.7", "c0ffeec0ffee", "&lt;none&gt;", "seed: 77", "paper software"),
        *("no acknowledgement for 0.5 s", "thruster: bus", "acceleration_cap"),
        *("2.40 ± 0.30 km", "below 1.0 km"),
        *("Edges of irregularities", "/relative_ekf", "lie within the stated 3 sigma"),
    ):
        assert said in text, said


def test_a_bag_alone_gives_the_numbers_of_its_run_folder(bag, page, tmp_path, monkeypatch):
    # The pictures of the run folder are those of `page`; only the numbers are compared.
    monkeypatch.setattr("vtff_analysis.report.write.draw_pictures", lambda *arguments: [])
    run = tmp_path / "run"
    shutil.copytree(bag, run / "bag")
    (run / "scenario.yaml").write_text(SCENARIO)
    (run / "parameters").mkdir()
    for name, text in texts_of_run(run / "scenario.yaml").items():
        (run / "parameters" / f"{name}.yaml").write_text(text)
    write_arguments(run, {"system": "test_system", "gnss": "<none>"}, {"ros_domain_id": 7})
    assert describe_run_folder(run).scenario_text == SCENARIO
    folder = write_report(run, Console(file=io.StringIO()))
    assert folder == run / "report"
    alone = json.loads((page.parent / "summary.json").read_text())
    of_run = json.loads((folder / "summary.json").read_text())
    assert (alone.pop("run_name"), of_run.pop("run_name")) == ("recorded", "run")
    assert alone == of_run
    assert alone["run_seed"] == 77 and alone["acceleration_cap_m_per_s2"] == 0.5


def test_paths_of_the_machine_stay_out_of_the_bag():
    texts = {"bridge": "file: /data/me/vtff/config/a.yaml\noutput: /scratch/runs/7/bag\n"}
    described = RunDescription(parameter_texts=texts)
    custom = described.as_custom_data("/scratch/runs/7", "/data/me/vtff")
    assert custom == {"parameters/bridge": "file: config/a.yaml\noutput: ${run_directory}/bag\n"}
    assert described.as_custom_data("/", "/")["parameters/bridge"] == texts["bridge"]


def test_places_of_reports(bag, tmp_path):
    alone = find_run(bag)
    assert (alone.name, alone.output_folder("report")) == (
        "recorded",
        bag.with_name("recorded_report"),
    )
    (file,) = bag.glob("*.mcap")
    assert find_run(file).output_folder("report") == file.with_name("recorded_0_report")
    shutil.copytree(bag, tmp_path / "run" / "bag")
    of_run = find_run(tmp_path / "run")
    assert (of_run.name, of_run.output_folder("report")) == ("run", tmp_path / "run" / "report")


def test_navigation_errors_are_within_what_was_simulated(bag):
    error = navigation_error(read_run(bag).deputies["deputy"])
    settled = error.position_rtn[error.time > 60.5]
    sigma = error.position_sigma_rtn[error.time > 60.5]
    assert sigma[0] == pytest.approx([0.02, 0.01, 0.01])
    assert settled.std(axis=0) == pytest.approx(sigma[0], rel=0.3)
    assert (error.fraction_within_three_sigma() > 0.97).all()


def test_chromium_shows_it_without_a_console_message(page):
    chromium = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if chromium is None:
        pytest.skip("no Chromium on this machine")
    shown = subprocess.run(
        [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
        + ["--v=0", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "Recorded topics" in shown.stdout
    assert "CONSOLE" not in shown.stderr
