"""tools/setup.sh in a small copy of the tree, with stand-ins for every tool that it asks.

Nothing is downloaded, built or asked of this machine.
"""

from __future__ import annotations

import importlib.util
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
REAL_TOOLS = (
    *("awk", "bash", "cat", "chmod", "cp", "cut", "dirname", "env", "find", "flock", "grep"),
    *("head", "mkdir", "rm", "sh", "sha256sum", "sleep", "sort", "tail", "touch", "xargs"),
)
PYTHON_CHECK = re.search(r"python_check='\n(.*?)'\n", (ROOT / "tools/setup.sh").read_text(), re.S)

FAKE_PYTHON = """\
#!/bin/sh
echo "python $*" | head -n 1 >>"$CALLS"
case "$1 $2" in
  *base_prefix*) echo "${IDENTITY:-3.11}" ;;
  "-c "*) [ -z "$REASON" ] || { echo "$REASON" >&2; exit 1; } ;;
  "--version "*) echo "Python 3.11.0" ;;
  "-m venv") mkdir -p "$3/bin" && cp "$0" "$3/bin/python" && cp "$FAKES/colcon" "$3/bin/colcon" ;;
  "-m pip") [ -z "$PIP_ERROR" ] || { echo "$PIP_ERROR"; exit 1; }; sleep "${PIP_TIME:-0}" ;;
  "tools/write_environment.py "*) touch .venv/vtff_environment.sh ;;
esac
"""
FAKE_COLCON = """\
#!/bin/sh
echo "colcon $*" >>"$CALLS"
[ -z "$COLCON_ERROR" ] || { echo "$COLCON_ERROR"; exit 1; }
mkdir -p install
"""
FAKES = {
    "python3": FAKE_PYTHON,
    "colcon": FAKE_COLCON,
    "uname": '#!/bin/sh\n[ "$1" = -s ] && echo Linux || echo "${MACHINE:-x86_64}"\n',
    "getconf": '#!/bin/sh\n[ "$GLIBC" != none ] && echo "glibc ${GLIBC:-2.36}"\n',
    "df": '#!/bin/sh\necho header\necho "/dev/disk 9 9 ${FREE_KIB:-9000000} 9% /"\n',
    "cc": "#!/bin/sh\nexit ${CC_EXIT:-0}\n",
    "c++": "#!/bin/sh\n",
    "make": "#!/bin/sh\n",
}


class Tree:
    """A checkout with what the set-up reads."""

    def __init__(self, folder: pathlib.Path, name: str = "checkout") -> None:
        self.root = folder / name
        for part in ("tools", "requirements"):
            shutil.copytree(ROOT / part, self.root / part)
        package = self.root / "src/package/package.xml"
        package.parent.mkdir(parents=True)
        package.write_text("<package/>")
        self.fakes = folder / "fakes"
        self.calls = folder / "calls"
        self.fakes.mkdir()
        for tool in REAL_TOOLS:
            path = shutil.which(tool)
            assert path or tool == "flock", f"this machine has no {tool}"
            if path:
                (self.fakes / tool).symlink_to(path)
        for tool, text in FAKES.items():
            (self.fakes / tool).write_text(text)
            (self.fakes / tool).chmod(0o755)

    def start(self, *arguments: str, **settings: object) -> subprocess.Popen[str]:
        self.calls.write_text("")
        variables = {
            "PATH": str(self.fakes),
            "CALLS": str(self.calls),
            "FAKES": str(self.fakes),
            # Leftovers of another ROS and settings that must not matter.
            "AMENT_PREFIX_PATH": "/nonexistent",
            "CDPATH": "/usr",
            **{name: str(value) for name, value in settings.items()},
        }
        return subprocess.Popen(
            ["bash", "tools/setup.sh", *arguments],
            cwd=self.root,
            env=variables,
            # A job started in the background hands down an ignored SIGINT, which bash cannot trap.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def setup(self, *arguments: str, **settings: object) -> subprocess.CompletedProcess[str]:
        process = self.start(*arguments, **settings)
        output, errors = process.communicate(timeout=60)
        return subprocess.CompletedProcess([], process.returncode, output, errors)

    def work(self) -> list[str]:
        """Return which expensive steps the last call did."""
        text = self.calls.read_text()
        return [step for step in (*ALL, TEST_PACKAGES) if step in text]


ALL = ["-m venv", "lock.txt.halves/first", "colcon build"]
TEST_PACKAGES = "lock_test.txt.halves/first"


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path)


def assert_fails(result, text):
    assert result.returncode == 1
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("setup: ")
    assert text in lines[0]


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"MACHINE": "aarch64"}, "x86-64 Linux; this is Linux aarch64"),
        ({"GLIBC": "2.31"}, "glibc 2.35 or newer is needed (Ubuntu 22.04, Debian 12); found 2.31"),
        ({"GLIBC": "none"}, "found none"),  # musl
        ({"CC_EXIT": 1}, "the C compiler 'cc' does not work"),
        ({"FREE_KIB": 1000000}, "not enough disk: 976 MiB free, 1367 MiB needed"),
        ({"REASON": "is Python 3.9"}, "Python 3.10 to 3.13 is needed; python3 is Python 3.9"),
        ({"REASON": "lacks its C headers"}, "python3 lacks its C headers"),
        ({"VTFF_PYTHON": "nosuch"}, "VTFF_PYTHON=nosuch is not a program"),
        ({"VTFF_PYTHON": "python3", "REASON": "is Python 3.9"}, "VTFF_PYTHON=python3 is Python"),
        (
            {"PIP_ERROR": "NewConnectionError: Temporary failure in name resolution"},
            "packages could not be downloaded: no network, or the index lacks them; "
            "details: log/setup.log",
        ),
        ({"PIP_ERROR": "OSError: [Errno 28] No space left on device"}, "the disk is full"),
        ({"COLCON_ERROR": "error: expected ';'"}, "building the workspace (half a minute) failed"),
    ],
)
def test_one_clear_line(tree, settings, text):
    assert_fails(tree.setup(**settings), text)


@pytest.mark.parametrize("tool", ["cc", "c++", "make"])
def test_missing_compiler(tree, tool):
    (tree.fakes / tool).unlink()
    assert_fails(tree.setup(), f"no C/C++ compiler: '{tool}' not found")
    assert not (tree.root / ".venv").exists()


def test_missing_python(tree):
    (tree.fakes / "python3").unlink()
    assert_fails(tree.setup(), "Python 3.10 to 3.13 is needed; python3 was not found")


def test_another_python_is_taken_where_python3_is_unsuitable(tree):
    shutil.copy(tree.fakes / "python3", tree.fakes / "python3.12")
    (tree.fakes / "python3").write_text("#!/bin/sh\nexit 127\n")  # a version manager's shim
    assert tree.setup().returncode == 0


@pytest.mark.parametrize("name", ["a checkout", "a:checkout", "$checkout"])
def test_impossible_path(tmp_path, name):
    tree = Tree(tmp_path, name)
    assert_fails(tree.setup(), "the path of this folder has a blank, colon")
    assert not (tree.root / ".venv").exists()


def test_second_call_does_nothing(tree):
    assert tree.setup().returncode == 0
    assert tree.work() == ALL
    second = tree.setup()
    assert (second.returncode, second.stdout, second.stderr) == (0, "", "")
    assert tree.work() == []


def test_test_packages_come_on_demand_and_once(tree):
    tree.setup()
    assert tree.work() == ALL
    assert tree.setup("test").returncode == 0
    assert tree.work() == [TEST_PACKAGES]
    second = tree.setup("test")
    assert (second.returncode, second.stdout, second.stderr) == (0, "", "")
    assert tree.work() == []
    tree.setup()
    assert tree.work() == []


def test_clean_checkout_is_set_up_for_tests_in_one_call(tree):
    assert tree.setup("test").returncode == 0
    assert tree.work() == [*ALL, TEST_PACKAGES]


def test_set_up_for_use_installs_nothing_of_the_tests(tree):
    tree.setup()
    (tree.root / "requirements/lock_test.txt").write_text("a==1")
    tree.setup()
    assert tree.work() == []


def test_unknown_argument(tree):
    assert_fails(tree.setup("tests"), "unknown argument 'tests'; it is 'test' or nothing")


def test_failed_installation_of_test_packages_is_repeated(tree):
    tree.setup()
    assert_fails(tree.setup("test", PIP_ERROR="error"), "installing what the tests need")
    tree.setup("test")
    assert tree.work() == [TEST_PACKAGES]


def test_vtff_command_runs_in_the_environment(tree):
    tree.setup()
    command = (tree.root / ".venv/bin/vtff").read_text()
    assert f'. "{tree.root}/.venv/vtff_environment.sh"' in command
    assert os.access(tree.root / ".venv/bin/vtff", os.X_OK)


PLAIN = {"PATH": "/usr/bin:/bin", "HOME": "/"}


@pytest.mark.parametrize(
    ("settings", "shown"),
    [
        (PLAIN, "script "),
        ({**PLAIN, "PYTHONPATH": "own"}, "script own:script"),
        ({**PLAIN, "PYTHONPATH": "ros", "AMENT_PREFIX_PATH": "/opt/ros/jazzy"}, "script script"),
        ({**PLAIN, "PYTHONPATH": "own", "AMENT_PREFIX_PATH": "/x:PREFIX"}, "absent own"),
    ],
    ids=("nothing sourced", "own folders stay", "another ROS gives way", "sourced already"),
)
def test_python_sets_the_environment_itself(tmp_path, settings, shown):
    """With its arguments, its input and its exit code, and once only."""
    spec = importlib.util.spec_from_file_location("w", ROOT / "tools/write_environment.py")
    written = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(written)
    script = tmp_path / "environment.sh"
    script.write_text("export LIBRARIES=script PYTHONPATH=script AMENT_PREFIX_PATH=PREFIX\n")
    module = written.PYTHON_MODULE.format(script=str(script), prefix="PREFIX")
    program = tmp_path / "program.py"
    program.write_text(
        f"{module}\nprint(os.environ.get('LIBRARIES', 'absent'), os.environ['PYTHONPATH'])\n"
        "print(sys.argv[1:], input())\nsys.exit(7)\n"
    )
    done = subprocess.run(
        [sys.executable, "-S", str(program), "a", "b c"],
        env=settings,
        input="line\n",
        capture_output=True,
        text=True,
    )
    assert done.returncode == 7, done.stderr
    first, second = done.stdout.splitlines()
    assert first == (f"{shown}script" if shown.endswith(" ") else shown)
    assert second == "['a', 'b c'] line"


@pytest.mark.parametrize("home", [{}, {"HOME": "/"}], ids=("without HOME", "with HOME"))
def test_python_of_this_workspace_needs_nothing_sourced(home, tmp_path):
    """Nor a home folder: CI and cron may lack one, and the first log entry wants a place."""
    python = ROOT / ".venv/bin/python"
    if not (ROOT / ".venv/vtff_environment.sh").is_file():
        pytest.skip("this workspace was not made by tools/setup.sh")
    code = (
        "import rclpy, vtff_msgs.msg, vtff_analysis; print(vtff_msgs.msg.RelativeState().header)\n"
        "rclpy.init(domain_id=0); rclpy.create_node('test').get_logger().warning('a first entry')"
    )
    settings = {"PATH": PLAIN["PATH"], **home}
    if home:
        settings["ROS_LOG_DIR"] = str(tmp_path)
    command = [python, "-c", code]
    done = subprocess.run(command, env=settings, capture_output=True, text=True, cwd="/")
    assert done.returncode == 0, done.stderr
    assert "a first entry" in done.stderr


def test_an_environment_that_is_broken_does_not_start_python_for_ever(tmp_path):
    spec = importlib.util.spec_from_file_location("w", ROOT / "tools/write_environment.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    script, starts = tmp_path / "environment.sh", tmp_path / "starts"
    script.write_text(f'echo start >> "{starts}"; export AMENT_PREFIX_PATH=/x PYTHONPATH=/\n')
    code = module.PYTHON_MODULE.format(script=str(script), prefix="/nonexistent")
    (tmp_path / "begin.py").write_text(code + "print('begun')\n")
    command = [sys.executable, "-S", tmp_path / "begin.py"]
    done = subprocess.run(command, env=PLAIN, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("begun\n", 0), done.stderr
    assert starts.read_text() == "start\n"


@pytest.mark.parametrize(
    ("change", "work"),
    [
        (
            lambda root: (root / "tools/patch_wheels.py").write_text(""),
            [*ALL, TEST_PACKAGES],
        ),
        (
            lambda root: (root / ".venv/.vtff_packages").unlink(),
            [*ALL, TEST_PACKAGES],
        ),  # interrupted before
        (
            lambda root: (root / ".venv/bin/python").unlink(),
            [*ALL, TEST_PACKAGES],
        ),  # interpreter was removed
        (lambda root: (root / "src/package/package.xml").write_text("<a/>"), ["colcon build"]),
        (lambda root: (root / "src/package/setup.py").write_text(""), ["colcon build"]),
        (lambda root: shutil.rmtree(root / "install"), ["colcon build"]),
        (lambda root: (root / ".venv/vtff_environment.sh").unlink(), ["colcon build"]),
        (lambda root: (root / "src/package/module.py").write_text(""), []),
        (lambda root: (root / "requirements/runtime.txt").write_text("numpy"), []),
        (lambda root: (root / "requirements/lock_test.txt").write_text("a==1"), [TEST_PACKAGES]),
        (lambda root: (root / "requirements/lock.txt").write_text("a==1"), [*ALL, TEST_PACKAGES]),
    ],
)
def test_what_is_done_again(tree, change, work):
    assert tree.setup("test").returncode == 0
    change(tree.root)
    assert tree.setup("test").returncode == 0
    assert tree.work() == work
    tree.setup("test")
    assert tree.work() == []


def test_another_interpreter_makes_another_environment(tree):
    tree.setup()
    other = tree.fakes / "other"
    other.write_text(FAKE_PYTHON.replace("${IDENTITY:-3.11}", "3.13"))
    other.chmod(0o755)
    assert tree.setup(VTFF_PYTHON=other).returncode == 0
    assert tree.work() == ALL
    tree.setup(VTFF_PYTHON=other)
    assert tree.work() == []


def test_moved_checkout_is_set_up_again(tree):
    tree.setup()
    tree.root = tree.root.rename(tree.root.with_name("moved"))
    assert tree.setup().returncode == 0
    assert tree.work() == ALL


def test_failed_build_is_repeated(tree):
    tree.setup()
    (tree.root / "src/package/package.xml").write_text("<a/>")
    assert tree.setup(COLCON_ERROR="error").returncode == 1
    # Also where the change is taken back: what the failed build left is unknown.
    (tree.root / "src/package/package.xml").write_text("<package/>")
    tree.setup()
    assert tree.work() == ["colcon build"]


def test_what_an_older_build_has_linked_is_gone_before_colcon_runs(tree):
    """Colcon copies dangling links of configuration files that were removed, and fails."""
    (tree.root / "src/package/setup.py").write_text("")
    tree.setup()
    for folder in ("build/package/config", "install/package/share/was_a_folder", "install/moved"):
        (tree.root / folder).mkdir(parents=True)
        (tree.root / folder / "removed.yaml").symlink_to(tree.root / "config/removed.yaml")
    kept = tree.root / "build/package/package"
    kept.symlink_to(tree.root / "src/package")
    (tree.root / "config").mkdir()
    (tree.root / "config/added.yaml").write_text("")
    assert tree.setup(COLCON_ERROR="error").returncode == 1
    assert not list((tree.root / "build/package").glob("config"))
    assert not list((tree.root / "install/package").glob("share"))
    assert not (tree.root / "install/moved").exists()
    # What runs meanwhile finds its modules.
    assert kept.is_symlink()


@pytest.mark.parametrize(
    ("name", "is_built_anew"),
    [
        ("msg/New.msg", True),
        ("srv/New.srv", True),
        ("CMakeLists.txt", True),
        ("package.xml", True),
        ("setup.py", True),
        ("msg/Old.msg", False),  # changed fields are for the compiler's own bookkeeping
    ],
)
def test_a_package_whose_description_changed_is_built_from_nothing(tree, name, is_built_anew):
    package = tree.root / "src/package"
    (package / "srv").mkdir()
    (package / "msg").mkdir()
    (package / "msg/Old.msg").write_text("float64 value")
    tree.setup()
    stale = tree.root / "build/package/stale"
    stale.write_text("")
    (package / name).write_text("float64 other")
    tree.setup()
    assert tree.work() == ["colcon build"]
    assert stale.exists() != is_built_anew


def wait_for_pip(tree):
    deadline = time.monotonic() + 30
    while "-m pip" not in tree.calls.read_text():
        assert time.monotonic() < deadline, "the set-up does not reach pip"
        time.sleep(0.02)


def working_folder(number):
    """Return the working folder of a process; None if it has ended or does not tell it."""
    try:
        return os.readlink(f"/proc/{number}/cwd")
    except OSError:
        return None


def assert_no_process_in(folder):
    """Wait until no process works in a folder: what the set-up started is gone with it."""
    deadline = time.monotonic() + 30
    while left := [
        number
        for number in filter(str.isdigit, os.listdir("/proc"))
        if working_folder(number) == os.path.realpath(folder)
    ]:
        assert time.monotonic() < deadline, left
        time.sleep(0.02)


def test_interrupted_set_up_is_repaired(tree):
    process = tree.start(PIP_TIME=20)
    wait_for_pip(tree)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "setup: interrupted; call it again" in errors
    assert_no_process_in(tree.root)
    assert tree.setup().returncode == 0
    assert tree.work() == ALL


@pytest.mark.skipif(shutil.which("flock") is None, reason="flock is not installed")
def test_second_set_up_at_the_same_time_waits(tree):
    first = tree.start(PIP_TIME=0.5)
    wait_for_pip(tree)
    calls = tree.calls.read_text()
    second = tree.start(PIP_TIME=0.5)
    output, _ = second.communicate(timeout=30)
    first.communicate(timeout=30)
    assert (first.returncode, second.returncode) == (0, 0)
    assert "waiting for another set-up" in output
    assert (calls + tree.calls.read_text()).count("-m pip") == 2  # half each


@pytest.mark.parametrize(
    ("before", "text"),
    [
        ("", ""),
        ("import sys; sys.version_info = (3, 9, 1)", "is Python 3.9"),
        ("import sys; sys.version_info = (3, 14, 0)", "is Python 3.14"),
        ("import sys; sys.maxsize = 2**31 - 1", "is a 32-bit Python"),
        ("import sys; sys.modules['ensurepip'] = None", "lacks the venv module"),
        ("import os; os.path.isfile = lambda path: False", "lacks its C headers"),
    ],
)
def test_python_check(before, text):
    assert PYTHON_CHECK
    if not text and not (3, 10) <= sys.version_info[:2] <= (3, 13):
        pytest.skip("this Python is not one that the wheels support")
    result = subprocess.run(
        [sys.executable, "-c", before + "\n" + PYTHON_CHECK.group(1)],
        capture_output=True,
        text=True,
    )
    assert result.returncode == (1 if text else 0)
    assert text in result.stderr
