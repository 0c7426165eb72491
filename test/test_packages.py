"""Declarations and imports of the packages: the layering, the rosdep keys, the versions."""

from __future__ import annotations

import ast
import pathlib
import re
import subprocess
import sys

import pytest

from vtff_node.plain_yaml import parse_yaml

catkin_package = pytest.importorskip("catkin_pkg.package", reason="catkin_pkg is not installed")

ROOT = pathlib.Path(__file__).resolve().parents[1]
FOLDERS = {path.parent.name: path.parent for path in sorted((ROOT / "src").glob("*/package.xml"))}

#: Module -> rosdep key, where they differ; a ROS package is its own key.
KEYS = {
    "PIL": "python3-pil",
    "brahe": "python3-brahe-pip",
    "can": "python3-can",
    "cantools": "python3-cantools-pip",
    "crccheck": "python-crccheck-pip",
    "clarabel": "python3-clarabel-pip",
    "cvxpy": "python3-cvxpy-pip",
    "dask": "python3-dask-pip",
    "distributed": "python3-distributed-pip",
    "filterpy": "python3-filterpy-pip",
    "hatanaka": "python3-hatanaka-pip",
    "hypothesis": "python3-hypothesis",
    "jinja2": "python3-jinja2",
    "lz4": "python3-lz4-pip",
    "matplotlib": "python3-matplotlib",
    "mcap": "python3-mcap-pip",
    "numba": "python3-numba",
    "novatel_edie": "python3-novatel-edie-pip",
    "numpy": "python3-numpy",
    "psutil": "python3-psutil",
    "pyarrow": "python3-pyarrow-pip",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "ruamel": "python3-ruamel.yaml",
    "scipy": "python3-scipy",
    "serial": "python3-serial",
    "typer": "python3-typer",
    "yaml": "python3-yaml",
    "zstandard": "python3-zstandard-pip",
}
#: Keys of the official list (ros/rosdistro, rosdep/python.yaml); the others are in rosdep/.
OFFICIAL = set(KEYS.values()) - {
    "python3-brahe-pip",
    "python3-clarabel-pip",
    "python3-cvxpy-pip",
    "python3-dask-pip",
    "python3-distributed-pip",
    "python3-hatanaka-pip",
    "python3-lz4-pip",
    "python3-mcap-pip",
    "python3-novatel-edie-pip",
    "python3-pyarrow-pip",
    "python3-zstandard-pip",
}
#: ROS packages of apt ROS 2 Jazzy that may be named.
ROS_PACKAGES = {
    *("action_msgs", "ament_cmake", "ament_index_python", "builtin_interfaces"),
    *("diagnostic_msgs",),
    *("domain_coordinator", "geometry_msgs", "launch", "launch_ros", "nav_msgs", "rcl_interfaces"),
    *("rclpy", "rosgraph_msgs", "rosidl_default_generators", "rosidl_default_runtime"),
    *("sensor_msgs", "std_msgs", "std_srvs"),
}
#: Referees that tests of a package may use, and skip without: they have no rosdep key.
OPTIONAL_IN_TESTS = {"czml3", "georinex", "oem", "pandas", "pyrtklib"}

#: Package -> the vtff packages that its code may import (design: imports run one way).
LIBRARIES = {"vtff_dynamics": set(), "vtff_gnss": {"vtff_dynamics"}}
FOR_NODES = {"vtff_dynamics", "vtff_gnss", "vtff_msgs", "vtff_node"}
NODES = {"vtff_control", "vtff_iono", "vtff_nav", "vtff_sim_bridge"}
MAY_IMPORT = {
    "vtff_msgs": set(),
    **LIBRARIES,
    "vtff_node": {*LIBRARIES, "vtff_msgs"},
    "vtff_control": FOR_NODES,
    "vtff_iono": FOR_NODES,
    "vtff_nav": FOR_NODES,
    "vtff_sim_bridge": FOR_NODES,
    "vtff_bag": {"vtff_dynamics", "vtff_msgs", "vtff_node"},
    "vtff_analysis": {*FOR_NODES, *NODES, "vtff_bag"},
    "vtff_bringup": set(FOLDERS) - {"vtff_bringup"},
}
NO_ROS = {"rclpy", "vtff_msgs", "vtff_node"}
MACHINE_PATH = re.compile(r"""(?<![\w.$}/])/(?:home|root|Users|work|opt/(?!ros\b|python\b))[/\w]""")


def imports(package, *, tests):
    """Return the top-level modules that the code or the tests of a package import."""
    folder = FOLDERS[package]
    paths = [path for path in folder.rglob("*.py") if path.name != "setup.py"]
    # conftest.py lets tests import the helper modules of every test folder.
    helpers = (*ROOT.glob("test/*.py"), *ROOT.glob("src/*/test/*.py"))
    own = {path.stem for path in (*paths, *helpers)} if tests else set()
    modules = set()
    for path in paths:
        if ("test" in path.relative_to(folder).parts) != tests:
            continue
        for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
            if isinstance(statement, ast.Import):
                modules |= {name.name.split(".")[0] for name in statement.names}
            elif isinstance(statement, ast.ImportFrom) and not statement.level:
                modules.add((statement.module or "").split(".")[0])
    return modules - set(sys.stdlib_module_names) - own - {package}


def declared(package, *kinds):
    description = catkin_package.parse_package(str(FOLDERS[package]))
    return {dependency.name for kind in kinds for dependency in getattr(description, kind)}


def setup_argument(package, name):
    """Return a literal keyword argument of the package's `setup()`, or None."""
    tree = ast.parse((FOLDERS[package] / "setup.py").read_text(encoding="utf-8"))
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "setup":
            for keyword in call.keywords:
                if keyword.arg == name:
                    return ast.literal_eval(keyword.value)
    return None


PYTHON_PACKAGES = [name for name, folder in FOLDERS.items() if (folder / "setup.py").is_file()]


def test_every_package_has_its_place():
    assert set(FOLDERS) == set(MAY_IMPORT)


@pytest.mark.parametrize("package", FOLDERS)
def test_package_xml_is_valid(package):
    description = catkin_package.parse_package(str(FOLDERS[package]))
    warnings = []
    description.validate(warnings=warnings)
    assert not warnings
    assert description.name == package
    assert description.licenses == ["Apache-2.0"]


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_setup_py_says_the_same(package):
    description = catkin_package.parse_package(str(FOLDERS[package]))
    assert setup_argument(package, "version") == description.version
    assert setup_argument(package, "description") == description.description
    assert setup_argument(package, "license") == description.licenses[0]
    assert setup_argument(package, "maintainer_email") == description.maintainers[0].email


def test_files_beside_the_modules_are_installed_with_them():
    """What git holds in a package besides its modules; pyproject.toml is for use without ROS."""
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    of_all = declared["tool"]["setuptools"]["package-data"]
    listed = subprocess.run(["git", "ls-files", "src"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("no git checkout")
    missing = []
    for path in map(pathlib.PurePosixPath, listed.stdout.splitlines()):
        package = path.parts[1]
        if path.parts[2:3] != (package,) or path.suffix == ".py" or package not in PYTHON_PACKAGES:
            continue
        inside = pathlib.PurePosixPath(*path.parts[3:])
        if not any(inside.match(each) for each in [*of_all["*"], *of_all.get(package, [])]):
            missing.append(str(path))
    assert not missing


def test_one_version():
    versions = {
        catkin_package.parse_package(str(folder)).version: name for name, folder in FOLDERS.items()
    }
    assert len(versions) == 1, versions


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_imports_are_declared(package):
    run = {KEYS.get(module, module) for module in imports(package, tests=False)}
    missing = run - declared(package, "exec_depends")
    assert not missing, f"{package}/package.xml lacks exec_depend {sorted(missing)}"
    # Tests may see the whole workspace. Naming each package of it could close a circle.
    tested = imports(package, tests=True) - OPTIONAL_IN_TESTS - set(FOLDERS)
    missing = {KEYS.get(module, module) for module in tested} - declared(
        package, "exec_depends", "test_depends"
    )
    assert not missing, f"{package}/package.xml lacks test_depend {sorted(missing)}"


def requirement_name(text):
    return re.split(r"[\[<>=!~ ]", text)[0].lower().replace("_", "-")


def runtime_requirements():
    lines = (ROOT / "requirements/runtime.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


#: Module -> distribution, where they differ.
DISTRIBUTIONS = {
    "PIL": "pillow",
    "can": "python-can",
    "foxglove": "foxglove-sdk",
    "novatel_edie": "novatel-edie",
    "ruamel": "ruamel.yaml",
    "serial": "pyserial",
}


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_setup_py_requires_what_is_imported(package):
    required = setup_argument(package, "install_requires")
    version = setup_argument(package, "version")
    allowed = {*runtime_requirements(), *(f"{name}=={version}" for name in FOLDERS)}
    assert set(required) <= allowed, "ranges are those of requirements/runtime.txt"
    modules = imports(package, tests=False) - ROS_PACKAGES - {"vtff_msgs"}
    if package in ("vtff_control", "vtff_iono", "vtff_nav"):
        modules.discard("vtff_node")  # only nodes import it, and they need ROS
    needed = {DISTRIBUTIONS.get(m, m).lower().replace("_", "-") for m in modules}
    assert needed <= {requirement_name(text) for text in required}


def test_distribution_vtff_is_the_packages():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.11 has tomllib")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project = settings["project"]
    versions = {setup_argument(package, "version") for package in PYTHON_PACKAGES}
    assert versions == {project["version"]}
    everything = [*project["dependencies"], *project["optional-dependencies"]["ros"]]
    assert sorted(everything) == sorted(runtime_requirements())
    libraries = ("vtff_dynamics", "vtff_gnss", "vtff_nav", "vtff_iono", "vtff_control")
    needed = {text for name in libraries for text in setup_argument(name, "install_requires")}
    assert {text for text in needed if not text.startswith("vtff_")} <= set(project["dependencies"])
    found = settings["tool"]["setuptools"]["packages"]["find"]["where"]
    assert sorted(found) == [f"src/{package}" for package in sorted(PYTHON_PACKAGES)]
    for group, entries in project["entry-points"].items():
        lines = [
            line
            for package in PYTHON_PACKAGES
            for line in (setup_argument(package, "entry_points") or {}).get(group, [])
        ]
        assert sorted(lines) == sorted(f"{name} = {value}" for name, value in entries.items())


def test_colcon_finds_an_order():
    """colcon counts test_depend too."""
    kinds = ("buildtool_depends", "build_depends", "exec_depends", "test_depends")
    waiting = {package: declared(package, *kinds) & set(FOLDERS) for package in FOLDERS}
    while waiting:
        ready = {package for package, needed in waiting.items() if not needed & set(waiting)}
        assert ready, f"packages depend on each other: {sorted(waiting)}"
        for package in ready:
            del waiting[package]


@pytest.mark.parametrize("package", FOLDERS)
def test_every_dependency_can_be_resolved(package):
    custom = set(parse_yaml((ROOT / "rosdep/vtff.yaml").read_text(encoding="utf-8")))
    names = declared(package, "buildtool_depends", "build_depends", "exec_depends", "test_depends")
    unknown = names - custom - OFFICIAL - ROS_PACKAGES - set(FOLDERS)
    assert not unknown, f"no rosdep key is known for {sorted(unknown)}"


def test_custom_keys_are_used():
    custom = set(parse_yaml((ROOT / "rosdep/vtff.yaml").read_text(encoding="utf-8")))
    used = {name for package in FOLDERS for name in declared(package, "exec_depends")}
    assert custom <= used
    assert not custom & OFFICIAL


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_imports_run_one_way(package):
    used = {module for module in imports(package, tests=False) if module.startswith("vtff_")}
    wrong = used - MAY_IMPORT[package]
    assert not wrong, f"{package} imports {sorted(wrong)}"


@pytest.mark.parametrize("package", LIBRARIES)
def test_libraries_know_no_ros(package):
    assert not imports(package, tests=False) & NO_ROS


def test_no_paths_of_a_machine():
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if listed.returncode:
        pytest.skip("this is no git checkout")
    found = []
    for name in filter(None, listed.stdout.split("\0")):
        path = ROOT / name
        # Binary files and what was deleted since have no lines to look at.
        if path == pathlib.Path(__file__) or not path.is_file() or path.stat().st_size > 500_000:
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found += [
            f"{name}:{number}: {line.strip()[:100]}"
            for number, line in enumerate(text.splitlines(), 1)
            if MACHINE_PATH.search(line)
        ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_no_sentence_begins_without_its_noun(package):
    """A line "Of the deputy, m." leaves open what the value is."""
    elliptical = re.compile(r'^\s*(?:#:? |""")?Of ')
    lines = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in sorted((ROOT / "src" / package).rglob("*.py"))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if elliptical.match(line)
    ]
    assert lines == []
