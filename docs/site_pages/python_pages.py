"""Pages of the Python modules: one for each room, the folder of a package."""

from __future__ import annotations

import ast
import collections
import pathlib


def find_rooms(root: pathlib.Path) -> dict[str, list[str]]:
    """Return the modules of each room: dotted name of the folder -> dotted names of its modules."""
    rooms: dict[str, list[str]] = collections.defaultdict(list)
    for package in sorted((root / "src").glob("vtff_*/vtff_*")):
        if package.name != package.parent.name or not (package / "__init__.py").exists():
            continue
        for file in sorted(package.rglob("*.py")):
            if file.name == "__main__.py" or not (file.parent / "__init__.py").exists():
                continue
            parts = file.relative_to(package.parent).with_suffix("").parts
            room = ".".join(parts[:-1])
            if parts[-1] != "__init__":
                rooms[room].append(".".join(parts))
            elif _public_names(file):
                rooms[room].append(room)
    return {room: modules for room, modules in sorted(rooms.items()) if modules}


def public_objects(root: pathlib.Path) -> set[str]:
    """Return the dotted names of all public functions and classes, as the source files define them.

    Private modules and what a module's ``__all__`` leaves out do not count.
    """
    names = set()
    for modules in find_rooms(root).values():
        for module in modules:
            package = module.partition(".")[0]
            file = (root / "src" / package).joinpath(*module.split("."))
            source = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
            names |= {f"{module}.{name}" for name in _public_names(source)}
    return names


def room_page(room: str, modules: list[str]) -> str:
    """Return the page of a room: its modules and their public objects as the source orders them."""
    lines = [f"# {room}", ""]
    for module in modules:
        lines += [f"## {module}", "", "```{eval-rst}", f".. automodule:: {module}"]
        lines += ["   :members:", "   :show-inheritance:", "```", ""]
    return "\n".join(lines)


def _public_names(source: pathlib.Path) -> set[str]:
    tree = ast.parse(source.read_text(encoding="utf-8"))
    exported: set[str] | None = None
    defined = set()
    for statement in tree.body:
        if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            if not statement.name.startswith("_"):
                defined.add(statement.name)
        elif isinstance(statement, ast.Assign) and any(
            isinstance(target, ast.Name) and target.id == "__all__" for target in statement.targets
        ):
            exported = set(ast.literal_eval(statement.value))
    return defined if exported is None else defined & exported
