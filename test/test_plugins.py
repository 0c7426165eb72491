"""Plug-ins of a package outside the tree fly; broken ones are named."""

from __future__ import annotations

import os
import pathlib
import re
import subprocess
import sys
import time

import numpy as np
import pytest

from vtff_bag.file.reader import BagReader
from vtff_control.tracking.controller import (
    ControllerSetting,
    ControlResult,
    check_control_result,
)
from vtff_control.tracking.sdre import DESIGNS
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.solution import RelativeSolution, check_solution
from vtff_nav.relative_ekf_node import RelativeEkfParameters, estimator_setting
from vtff_node.plugins.groups import CONTROLLERS
from vtff_node.plugins.loading import Plugin, PluginError, load_plugin, plugin_names

ROOT = pathlib.Path(__file__).resolve().parents[1]


def install(folder: pathlib.Path, sources: dict[str, str], entry_points: str) -> None:
    """Make an installed package mylab 1.0, as pip would."""
    package = folder / "mylab"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    for name, source in sources.items():
        (package / name).write_text(source)
    metadata = folder / "mylab-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry_points)


def documented_files() -> dict[str, str]:
    """Return the files that docs/plugins.md prints, by name."""
    text = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
    blocks = re.findall(r"\*\*mylab/(?:mylab/)?([a-z.]+)\*\*:\n\n```\w+\n(.*?)```", text, re.DOTALL)
    return dict(blocks)


def fly(packages: pathlib.Path, run: pathlib.Path, *arguments: str):
    search_path = os.pathsep.join((str(packages), os.environ.get("PYTHONPATH", "")))
    return subprocess.run(
        [sys.executable, "-m", "vtff_bringup.cli", "run", *arguments, "--no-report"]
        + ["--composed", "--out", str(run)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240.0,
        env={**os.environ, "PYTHONPATH": search_path, "COLUMNS": "1000"},
    )


def messages(run: pathlib.Path, topic: str):
    return [decoded.message for decoded in BagReader(run).messages(topic)]


@pytest.fixture(scope="module")
def mylab(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("packages")
    files = documented_files()
    del files["guided.yaml"]
    groups = re.findall(
        r'\[project\.entry-points\."(.*?)"\]\n(.*?)\n\n', files.pop("pyproject.toml"), re.DOTALL
    )
    install(folder, files, "".join(f"[{g}]\n{e}\n\n".replace('"', "") for g, e in groups))
    return folder


def test_documented_controller_flies(mylab, tmp_path):
    result = fly(
        mylab,
        tmp_path / "run",
        "reference_software",
        "--duration=30",
        "sdre_controller.design:=mylab_controller",
        "sdre_controller.stiffness:=2e-4",
    )
    assert result.returncode == 0, result.stdout + result.stderr
    states = messages(tmp_path / "run", "/deputy/relative_state_truth")
    commands = messages(tmp_path / "run", "/deputy/control/thrust_command")
    assert len(commands) >= 30
    # In-track the law of the document, at its own stiffness and the given one.
    wanted = -2e-4 * (states[0].position[1] - 100.0) - 2e-2 * states[0].velocity[1]
    assert commands[0].accel.linear.y == pytest.approx(wanted, rel=1e-12)


def test_documented_estimator_flies(mylab, tmp_path):
    result = fly(
        mylab,
        tmp_path / "run",
        "reference",
        "--duration=30",
        "relative_ekf.estimator:=mylab_filter",
    )
    assert result.returncode == 0, result.stdout + result.stderr
    truth = {
        (state.header.stamp.sec, state.header.stamp.nanosec): state
        for state in messages(tmp_path / "run", "/deputy/relative_state_truth")
    }
    errors = [
        np.linalg.norm(np.subtract(state.position, true.position))
        for state in messages(tmp_path / "run", "/deputy/relative_state")
        if state.solution == 2
        and (true := truth.get((state.header.stamp.sec, state.header.stamp.nanosec))) is not None
    ]
    assert len(errors) > 10
    assert np.median(errors) < 10.0  # m, of codes


def guided_system(folder: pathlib.Path) -> pathlib.Path:
    """Write the system file of the document, which has a guidance, and return its path."""
    text = documented_files()["guided.yaml"]
    path = folder / "guided.yaml"
    path.write_text(text.replace("SYSTEMS", str(ROOT / "config" / "system")))
    return path


def test_documented_guidance_flies(mylab, tmp_path):
    result = fly(
        mylab,
        tmp_path / "run",
        str(guided_system(tmp_path)),
        "--duration=30",
        "formation_guidance.speed:=2.0",
    )
    assert result.returncode == 0, result.stdout + result.stderr
    targets = messages(tmp_path / "run", "/deputy/target")
    along_track = [target.position[1] for target in targets]
    # The target moves at the given speed, and the controller's command follows from it.
    np.testing.assert_allclose(np.diff(along_track), -2.0, rtol=1e-12)
    assert targets[5].velocity[1] == -2.0
    stamps = [
        [message.header.stamp for message in messages(tmp_path / "run", topic)]
        for topic in ("/deputy/control/thrust_command", "/deputy/target")
    ]
    assert stamps[0] == stamps[1]


BROKEN_GUIDANCE = """
import time

import numpy as np

from vtff_control.guidance.interface import GuidanceResult, SpacecraftTarget


class Broken:
    def __init__(self, setting):
        self.setting = setting
        self.calls = 0

    def reset(self):
        pass

    def step(self, state):
        self.calls += 1
        target = SpacecraftTarget(np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0]), np.full(3, 0.01))
        if self.calls > 5:
            {statement}
        return GuidanceResult(dict.fromkeys(self.setting.spacecraft, target))
"""


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("target = SpacecraftTarget(np.zeros(3), np.zeros(3))", "6 numbers expected, got shape"),
        pytest.param(
            "1 / 0",
            "step: ZeroDivisionError: division by zero (broken.py, line 21)",
            marks=pytest.mark.slow,
        ),
        ("time.sleep(60.0)", "step: too slow, no answer within 2 s"),
    ],
)
def test_broken_guidance_is_named_and_the_run_ends_with_zero_feedforward(
    tmp_path, statement, reason
):
    packages = tmp_path / "packages"
    source = BROKEN_GUIDANCE.format(statement=statement)
    install(packages, {"broken.py": source}, "[vtff.guidances]\nbroken = mylab.broken:Broken\n")
    run = tmp_path / "run"
    settings = ("formation_guidance.guidance:=broken", "formation_guidance.compute_limit:=2.0")
    result = fly(packages, run, str(guided_system(tmp_path)), "--duration=30", *settings)
    assert result.returncode == 1, result.stdout + result.stderr
    lines = [line for line in (result.stdout + result.stderr).splitlines() if "mylab 1.0" in line]
    assert len(lines) == 1, result.stdout + result.stderr
    assert "guidance 'broken' (mylab 1.0, mylab.broken:Broken): " in lines[0]
    assert reason in lines[0]
    feedforward = messages(run, "/deputy/control/feedforward")
    assert [command.accel.linear.y for command in feedforward] == [0.01] * 5 + [0.0]


BROKEN = """
import time

import numpy as np

from vtff_control.tracking.controller import ControlResult


class Broken:
    def __init__(self, setting):
        self.calls = 0

    def reset(self):
        pass

    def control(self, relative_state_rtn, state_chief_gcrf, target_rtn, stamp=None):
        self.calls += 1
        if self.calls > 5:
            {statement}
        return ControlResult(np.full(3, 0.01), False, True)
"""


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("return ControlResult(np.full(3, np.nan), False, True)", "not finite"),
        ("time.sleep(60.0)", "too slow"),
    ],
)
def test_broken_controller_is_named_and_the_run_ends_with_zero_thrust(tmp_path, statement, reason):
    packages = tmp_path / "packages"
    source = BROKEN.format(statement=statement)
    install(packages, {"broken.py": source}, "[vtff.controllers]\nbroken = mylab.broken:Broken\n")
    run = tmp_path / "run"
    settings = ("sdre_controller.design:=broken", "sdre_controller.compute_limit:=2.0")
    result = fly(packages, run, "reference_software", "--duration=30", *settings)
    assert result.returncode == 1, result.stdout + result.stderr
    lines = [line for line in (result.stdout + result.stderr).splitlines() if "mylab 1.0" in line]
    assert len(lines) == 1, result.stdout + result.stderr
    assert "design 'broken' (mylab 1.0, mylab.broken:Broken): control: " in lines[0]
    assert reason in lines[0]
    commands = messages(run, "/deputy/control/thrust_command")
    assert [command.accel.linear.y for command in commands] == [0.01] * 5 + [0.0]


def plugin(tmp_path, monkeypatch, source: str, name: str = "Broken", value: str = "mylab.broken"):
    install(tmp_path, {"broken.py": source}, f"[vtff.controllers]\nbroken = {value}:{name}\n")
    monkeypatch.syspath_prepend(tmp_path)
    for module in [module for module in sys.modules if module.split(".")[0] == "mylab"]:
        monkeypatch.delitem(sys.modules, module)
    return load_plugin(CONTROLLERS, "broken")


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("return ControlResult(np.zeros(2), False, True)", "shape (2,)"),
        ("return ControlResult(np.zeros((3, 1)), False, True)", "shape (3, 1)"),
        ("return ControlResult(np.array([0.0, np.inf, 0.0]), False, True)", "not finite"),
        ("return np.zeros(3)", "a ControlResult is expected, got ndarray"),
        ("return None", "a ControlResult is expected, got NoneType"),
        ("return 1 / 0", "ZeroDivisionError: division by zero (broken.py, line 19)"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("time.sleep(30.0)", "too slow, no answer within 0.2 s"),
        ("while True: pass", "too slow, no answer within 0.2 s"),
    ],
)
def test_every_kind_of_broken_answer_is_named(tmp_path, monkeypatch, statement, reason):
    source = BROKEN.format(statement=statement).replace("> 5", "> 0")
    loaded = plugin(tmp_path, monkeypatch, source)
    loaded.call_limit = 0.2
    controller = loaded.make(ControllerSetting(), None)
    with pytest.raises(PluginError) as caught:
        loaded.call(
            controller.control, np.zeros(6), np.zeros(6), np.zeros(6), check=check_control_result
        )
    text = str(caught.value)
    assert text.startswith("design 'broken' (mylab 1.0, mylab.broken:Broken): control: ")
    assert reason in text
    assert "\n" not in text


def test_alarm_of_a_call_that_has_ended_does_not_ring(tmp_path, monkeypatch):
    loaded = plugin(tmp_path, monkeypatch, BROKEN.format(statement="pass"))
    loaded.call_limit = 0.05
    controller = loaded.make(ControllerSetting(), None)
    arguments = (np.zeros(6), np.zeros(6), np.zeros(6))
    assert loaded.call(controller.control, *arguments).valid
    time.sleep(0.1)


def test_calls_slower_than_real_time_are_counted(tmp_path, monkeypatch):
    statement = "time.sleep(0.03 * (self.calls > 7))"
    source = BROKEN.format(statement=statement).replace("np.full(3, 0.01), F", "np.zeros(3), F")
    loaded = plugin(tmp_path, monkeypatch, source)
    controller = loaded.make(ControllerSetting(), None)
    arguments = (np.zeros(6), np.zeros(6), np.zeros(6))
    for sample_time, late in ((60.0, 0), (0.02, 3)):
        loaded.sample_time = sample_time
        controller.calls = 0
        for _ in range(10):
            loaded.call(controller.control, *arguments, check=check_control_result)
        assert loaded.late_calls >= late
        assert bool(loaded.lateness) == bool(late)
        controller.reset()
        loaded.call(controller.reset)
    assert loaded.calls == 20
    assert "of 20 calls lasted longer than the 0.02 s between samples" in loaded.lateness
    assert loaded.lateness.startswith("design 'broken' (mylab 1.0, mylab.broken:Broken): ")


@pytest.mark.parametrize(
    ("source", "error", "reason"),
    [
        ("import no_such_module", PluginError, "cannot be loaded: ModuleNotFoundError"),
        ("class Other: ...", PluginError, "cannot be loaded: AttributeError"),
        ("Broken = 3", PluginError, "a class is expected, not int"),
        ("class Broken:\n    Parameters = dict\n", PluginError, "Parameters is not a dataclass"),
    ],
)
def test_what_cannot_be_loaded_is_named(tmp_path, monkeypatch, source, error, reason):
    with pytest.raises(error, match="mylab 1.0, mylab.broken:Broken") as caught:
        plugin(tmp_path, monkeypatch, source)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("body", "error", "reason"),
    [
        ("def __init__(self, setting): raise ValueError('gain')", ValueError, "gain"),
        ("def __init__(self): pass", PluginError, "TypeError"),
        ("def __init__(self, setting): pass", PluginError, "no method 'control'"),
    ],
)
def test_what_cannot_be_made_is_named(tmp_path, monkeypatch, body, error, reason):
    loaded = plugin(tmp_path, monkeypatch, f"class Broken:\n    {body}\n")
    with pytest.raises(error, match="mylab 1.0, mylab.broken:Broken") as caught:
        loaded.make(ControllerSetting(), None)
    assert reason in str(caught.value)


def test_shipped_ones_come_through_the_same_door():
    assert set(plugin_names("vtff.controllers")) >= set(DESIGNS)
    assert set(plugin_names("vtff.estimators")) >= {"cdgps", "paper"}
    assert "formation" in plugin_names("vtff.guidances")
    for name in DESIGNS:
        loaded: Plugin = load_plugin(CONTROLLERS, name)
        assert loaded.make(ControllerSetting(delay_steps=2), None).design.design == name


def test_name_that_is_not_installed_is_refused():
    with pytest.raises(ValueError, match="'design' is 'nobody'; installed are: .*paper"):
        load_plugin(CONTROLLERS, "nobody")


def test_two_packages_with_one_name_are_refused(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="several packages offer it: .*mylab 1.0"):
        install(tmp_path, {}, "[vtff.controllers]\npaper = mylab.broken:Paper\n")
        monkeypatch.syspath_prepend(tmp_path)
        load_plugin(CONTROLLERS, "paper")


def test_settings_have_the_defaults_of_the_node():
    assert estimator_setting(RelativeEkfParameters()) == EstimatorSetting()


def test_unusable_solution_is_refused():
    none = RelativeSolution.none(None, ("no reason",))
    check_solution(none)
    for field, value, reason in (
        ("position_rtn", np.zeros(2), r"position_rtn: .*\(3,\) expected, got shape \(2,\)"),
        ("covariance_rtn", np.zeros((3, 3)), "covariance_rtn"),
        ("solution", 5, "solution: 5"),
        ("solution", 4, "position_rtn: not finite"),
    ):
        with pytest.raises(ValueError, match=reason):
            check_solution(RelativeSolution(**{**vars(none), field: value}))
    with pytest.raises(ValueError, match="RelativeSolution is expected, got dict"):
        check_solution({})
    check_control_result(ControlResult(np.zeros(3), False, True))
