"""Rooms: no circle of files or folders, folders of a size to look over, algorithms without ROS."""

from __future__ import annotations

import ast
import collections
import functools
import itertools
import pathlib

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
CODE = sorted(path for path in (ROOT / "src").glob("vtff_*/vtff_*") if path.is_dir())
MOST_MODULES_OF_A_ROOM = 14
LARGEST_SHARE_OF_A_PACKAGE = 0.2

#: Packages whose modules are algorithms, and the modules in them that are ROS by nature: nodes, and
#: what nodes share (feeds, publishers and conversions between messages and the algorithms' values).
ALGORITHM_PACKAGES = ("vtff_control", "vtff_iono", "vtff_nav", "vtff_sim_bridge")
ROS_BY_NATURE = {
    "vtff_control.guidance_conversions",
    "vtff_iono.conversions",
    "vtff_nav.receiver.driver_parameters",
    "vtff_nav.receiver.event_publisher",
    "vtff_nav.receiver.live_feed",
    "vtff_nav.receiver.log_feed",
    "vtff_nav.relative_conversions",
}
ROS = ("rclpy", "rcl_interfaces", "ament_index_python", "domain_coordinator")


def module_name(path: pathlib.Path) -> str:
    parts = path.relative_to(path.parents[len(path.relative_to(ROOT / "src").parts) - 2]).parts
    names = [*parts[:-1], *([] if path.name == "__init__.py" else [path.stem])]
    return ".".join(names)


MODULES = {module_name(path): path for folder in CODE for path in sorted(folder.rglob("*.py"))}
ROOMS = sorted({path.parent for path in MODULES.values()})


def room_of(module: str) -> str:
    return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]


def needed_when_imported(statements: list[ast.stmt]) -> list[ast.stmt]:
    """Return the statements that run on import: without bodies of functions and TYPE_CHECKING."""
    found = []
    for statement in statements:
        found.append(statement)
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test):
            found += needed_when_imported(statement.orelse)
            continue
        for field in ("body", "orelse", "finalbody"):
            found += needed_when_imported(getattr(statement, field, []))
        for handler in getattr(statement, "handlers", []):
            found += needed_when_imported(handler.body)
    return found


@functools.cache
def imported_names(module: str, *, everywhere: bool) -> frozenset[str]:
    """Return the modules that a module imports, also inside functions if `everywhere`."""
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    names = set()
    for statement in ast.walk(tree) if everywhere else needed_when_imported(tree.body):
        if isinstance(statement, ast.Import):
            names |= {alias.name for alias in statement.names}
        elif isinstance(statement, ast.ImportFrom):
            assert not statement.level, f"{module}: relative import in line {statement.lineno}"
            source = statement.module or ""
            for alias in statement.names:
                inner = f"{source}.{alias.name}"
                names.add(inner if inner in MODULES else source)
    return frozenset(names)


def imports_of_own_modules() -> dict[str, set[str]]:
    return {
        module: {name for name in imported_names(module, everywhere=True) if name in MODULES}
        - {module}
        for module in MODULES
    }


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of nodes that reach each other (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    groups = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for neighbour in edges.get(node, ()):
            if neighbour not in index:
                visit(neighbour)
                low[node] = min(low[node], low[neighbour])
            elif neighbour in stack:
                low[node] = min(low[node], index[neighbour])
        if low[node] == index[node]:
            start = stack.index(node)
            group = stack[start:]
            del stack[start:]
            if len(group) > 1:
                groups.append(sorted(group))

    for node in edges:
        if node not in index:
            visit(node)
    return groups


def test_circles_are_found():
    """The search below can fail."""
    edges = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set(), "e": {"a", "f"}, "f": {"e"}}
    assert sorted(circles(edges)) == [["b", "c"], ["e", "f"]]


def test_no_circle_of_files():
    """Imports inside functions count: they hide a circle and do not open it."""
    found = circles(imports_of_own_modules())
    assert not found, "\n".join(" <-> ".join(group) for group in found)


def test_no_circle_of_rooms():
    edges: dict[str, set[str]] = collections.defaultdict(set)
    for module, names in imports_of_own_modules().items():
        edges[room_of(module)] |= {room_of(name) for name in names} - {room_of(module)}
    found = circles(edges)
    assert not found, "\n".join(" <-> ".join(group) for group in found)


@pytest.mark.parametrize("room", ROOMS, ids=lambda path: path.relative_to(ROOT / "src").as_posix())
def test_a_room_says_what_lives_in_it_and_can_be_looked_over(room):
    modules = [path.name for path in room.glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= MOST_MODULES_OF_A_ROOM, sorted(modules)
    initial = room / "__init__.py"
    assert initial.is_file(), f"{room} has modules and no __init__.py"
    docstring = ast.get_docstring(ast.parse(initial.read_text(encoding="utf-8")))
    assert docstring, f"{initial} does not say what lives in the room"
    assert len(docstring.splitlines()[0]) >= 15


def test_no_package_is_a_fifth_of_the_code():
    lines = collections.Counter()
    for module, path in MODULES.items():
        lines[module.split(".")[0]] += len(path.read_text(encoding="utf-8").splitlines())
    package, count = lines.most_common(1)[0]
    assert count <= LARGEST_SHARE_OF_A_PACKAGE * lines.total(), f"{package}: {count} lines"


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    return top in ROS or top.endswith(("_msgs", "_srvs", "_interfaces"))


ALGORITHMS = [
    module
    for module in MODULES
    if module.split(".")[0] in ALGORITHM_PACKAGES
    and not module.endswith("_node")
    and module not in ROS_BY_NATURE
]


@pytest.mark.parametrize("module", ALGORITHMS)
def test_algorithms_know_no_ros(module):
    """Neither themselves nor by anything of ours that they import."""
    seen, waiting = set(), [(module,)]
    while waiting:
        path = waiting.pop()
        packages = list(itertools.accumulate(path[-1].split(".")[:-1], "{}.{}".format))
        for name in (*imported_names(path[-1], everywhere=False), *packages):
            assert not is_ros(name), " -> ".join((*path, name))
            if name in MODULES and name not in seen:
                seen.add(name)
                waiting.append((*path, name))


def test_what_is_ros_by_nature_is_ros():
    """A module on the list that imports no ROS is an algorithm and leaves the list."""
    for module in ROS_BY_NATURE:
        assert module in MODULES, f"{module} is not there"
        names = imported_names(module, everywhere=True)
        assert any(is_ros(name) or name.startswith("vtff_node") for name in names), module
