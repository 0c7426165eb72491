"""Machine code of compiled functions as extension modules, which load without numba.

To import numba and to have it load a cached function takes half a second of processor; an extension
module is there after half a millisecond. numba makes both from the same intermediate code, so that
results are the same to the last bit.
"""

from __future__ import annotations

import enum
import functools
import hashlib
import importlib.machinery
import importlib.util
import os
import pathlib
import sys
import types
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

__all__ = [
    "argument_forms",
    "build_machine_code",
    "dispatching_function",
    "load_machine_code",
    "machine_code_path",
    "source_fingerprint",
]

#: Name of all extension modules: the parts of numba that are linked to each refer to it.
_MODULE = "vtff_machine_code"
_FUNCTION = "call"
_SCALARS: dict[type, str] = {
    float: "float",
    np.float64: "float",
    int: "int",
    np.int64: "int",
    bool: "bool",
    np.bool_: "bool",
}
_SCALAR_TYPES = {
    form: tuple(key for key, value in _SCALARS.items() if value == form)
    for form in ("float", "int", "bool")
}
#: Flags of an array that is writeable, aligned and of a layout; `flags.farray` of numpy 2.4 is true
#: of arrays that are not contiguous, too.
_FLAGS = {"C": "{0}.flags.carray", "F": "{0}.flags.fnc and {0}.flags.behaved"}
#: Instructions of the level x86-64-v3 beyond those of x86-64 (x86-64 psABI), as Linux names them.
_LEVEL_3 = set("avx avx2 bmi1 bmi2 f16c fma abm movbe xsave".split())


def argument_forms(arguments: Sequence[Any]) -> tuple[str, ...] | None:
    """Return of each argument what machine code depends on; None if there can be none for them.

    Scalars, arrays of numbers in the byte order of the machine, and named tuples of these have
    forms; forms of arrays are such as ``C float64 2``, with ``readonly`` where it is so.
    """
    forms = []
    for argument in arguments:
        form = _argument_form(argument)
        if form is None:
            return None
        forms.append(form)
    return tuple(forms)


def _argument_form(argument: Any) -> str | None:
    scalar = _SCALARS.get(type(argument))
    if scalar is not None:
        return scalar
    if type(argument) is np.ndarray:
        flags = argument.flags
        if argument.dtype.kind not in "fiubc" or not argument.dtype.isnative or not flags.aligned:
            return None
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        ending = "" if flags.writeable else " readonly"
        return f"{layout} {argument.dtype.name} {argument.ndim}{ending}"
    if isinstance(argument, tuple) and hasattr(argument, "_fields"):
        members = argument_forms(argument)
        if members is None:
            return None
        named = ", ".join(
            f"{name} {form}" for name, form in zip(argument._fields, members, strict=True)
        )
        return f"{type(argument).__module__}.{type(argument).__qualname__}({named})"
    return None


def dispatching_function(
    codes: dict[tuple[str, ...], Callable[..., Any]], otherwise: Callable[..., Any]
) -> Callable[..., Any]:
    """Return a function that calls the machine code for the forms of its arguments.

    Parameters
    ----------
    codes : dict
        Machine code by the forms of its arguments. It does not look at them itself: an array of
        another kind would be read wrongly.
    otherwise : callable
        Called where no form matches.
    """
    count = max(len(forms) for forms in codes)
    names = [f"argument_{place}" for place in range(count)]
    scope: dict[str, Any] = {
        "ndarray": np.ndarray,
        "form_of": _argument_form,
        "otherwise": otherwise,
        **{f"types_of_{form}": kinds for form, kinds in _SCALAR_TYPES.items()},
    }
    lines = [f"def dispatch({', '.join(names)}):"]
    for number, (forms, code) in enumerate(codes.items()):
        scope[f"code_{number}"] = code
        conditions = [
            _condition(name, form, scope) for name, form in zip(names, forms, strict=True)
        ]
        lines += [
            f"    if {' and '.join(conditions) or 'True'}:",
            f"        return code_{number}({', '.join(names)})",
        ]
    lines.append(f"    return otherwise({', '.join(names)})")
    exec("\n".join(lines), scope)
    function: Callable[..., Any] = scope["dispatch"]
    return function


def _condition(name: str, form: str, scope: dict[str, Any]) -> str:
    """Return the expression that tells whether an argument has a form; `scope` gets its values."""
    if form in _SCALAR_TYPES:
        return f"type({name}) in types_of_{form}"
    if "(" in form:
        return f"form_of({name}) == {form!r}"
    layout, kind, dimensions, *readonly = form.split(" ")
    scope[f"dtype_{kind}"] = np.dtype(kind)
    if layout in _FLAGS and not readonly:
        flags = _FLAGS[layout].format(name)
    else:
        flags = f"form_of({name}) == {form!r}"
    return (
        f"type({name}) is ndarray and {name}.ndim == {dimensions}"
        f" and {name}.dtype == dtype_{kind} and {flags}"
    )


def source_fingerprint(
    function: types.FunctionType, find_function: Callable[[Any], types.FunctionType | None]
) -> str | None:
    """Return a hash of a function and of everything that its machine code depends on.

    Parameters
    ----------
    function : function
    find_function : callable
        Returns the function behind a compiled one, None for other values.

    Returns
    -------
    str or None
        Changes with its code, with the constants that it reads and with the functions that it
        calls. None for functions within functions, whose values the hash does not know.
    """
    parts: list[str] = []
    waiting, known = [function], {function}
    while waiting:
        current = waiting.pop()
        if current.__closure__ or current.__defaults__ or current.__kwdefaults__:
            return None
        parts.append(current.__qualname__)
        names: list[str] = []
        for code in _codes(current.__code__):
            constants = [
                _describe(constant, ())
                for constant in code.co_consts
                if not isinstance(constant, types.CodeType) and constant is not current.__doc__
            ]
            parts += [code.co_code.hex(), *code.co_names, *code.co_varnames, *constants]
            names += code.co_names
        for name in names:
            if name not in current.__globals__:
                continue
            value = current.__globals__[name]
            called = find_function(value)
            if called is None:
                parts.append(f"{name} {_describe(value, names)}")
            elif called not in known:
                known.add(called)
                waiting.append(called)
    return _hash(parts)


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yield a code and those of the functions and comprehensions in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _describe(value: Any, names: Sequence[str]) -> str:
    """Return a text that changes with a value; of a module of ours with what `names` say of it."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"({', '.join(_describe(member, names) for member in value)})"
    if isinstance(value, frozenset):
        return f"{sorted(map(repr, value))}"
    if isinstance(value, types.ModuleType):
        if value.__name__.partition(".")[0] in ("math", "numpy"):
            return value.__name__
        members = {
            name: getattr(value, name) for name in sorted(set(names)) if hasattr(value, name)
        }
        return f"{value.__name__} {[_describe(member, ()) for member in members.values()]}"
    if isinstance(value, enum.EnumMeta):
        return f"{value.__qualname__} {[(name, repr(value[name])) for name in value.__members__]}"
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', '')}"
    if callable(value):
        return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
    return repr(value)


def machine_code_path(
    function: types.FunctionType, fingerprint: str, forms: Sequence[str]
) -> pathlib.Path:
    """Return where the machine code of a function for arguments of some forms is kept.

    It is in NUMBA_CACHE_DIR if that is set, else beside the source or, where nothing can be written
    there, in the user's cache folder.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    file = f"{name}.{fingerprint}.{_hash([*forms, *_environment()])}.so"
    return _cached(function.__code__.co_filename, file)


def _cached(source: str, file: str) -> pathlib.Path:
    """Return the path of a file that is made of a source."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return pathlib.Path(chosen) / file
    beside = pathlib.Path(source).parent / "__pycache__"
    if (beside / file).is_file() or _is_writable(beside):
        return beside / file
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return pathlib.Path(home) / "vtff" / file


def _is_writable(folder: pathlib.Path) -> bool:
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


@functools.cache
def _environment() -> tuple[str, ...]:
    """Return what machine code depends on besides the function and its arguments."""
    specification = importlib.util.find_spec("numba")
    if specification is None or specification.origin is None:
        raise ModuleNotFoundError("numba is not installed")
    version = os.stat(specification.origin)
    return (
        importlib.machinery.EXTENSION_SUFFIXES[0],
        np.__version__,
        f"{specification.origin} {version.st_mtime_ns} {version.st_size}",
        _processor_level(),
    )


def _processor_level() -> str:
    """Return the instructions that machine code may use, in the words of LLVM; "" for any."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("flags"):
                    return "x86-64-v3" if set(line.split()) >= _LEVEL_3 else ""
    except OSError:
        pass
    return ""


def load_machine_code(path: pathlib.Path) -> Callable[..., Any] | None:
    """Return the machine code in a file; None if there is no such file or it cannot be loaded."""
    loader = importlib.machinery.ExtensionFileLoader(_MODULE, str(path))
    specification = importlib.util.spec_from_file_location(_MODULE, path, loader=loader)
    if specification is None or not path.is_file():
        return None
    try:
        module = importlib.util.module_from_spec(specification)
        loader.exec_module(module)
    except ImportError:
        return None
    function: Callable[..., Any] = getattr(module, _FUNCTION)
    return function


def build_machine_code(
    function: types.FunctionType, arguments: Sequence[Any], path: pathlib.Path
) -> bool:
    """Compile a function for arguments of some types into a file; tell whether that was possible.

    Parameters
    ----------
    function : function
        What it calls is compiled by numba.
    arguments : sequence
        Values of the types that it is compiled for.
    path : pathlib.Path
        Older machine code of the same function there is removed.

    Raises
    ------
    numba.core.errors.NumbaError
        If numba cannot compile the function.
    """
    # Imported here, because few processes compile.
    import shutil
    import sysconfig
    import tempfile

    compiler = shutil.which("cc")
    header = pathlib.Path(sysconfig.get_paths()["include"]) / "Python.h"
    if compiler is None or shutil.which("c++") is None or not header.is_file():
        return False
    import numba
    from numba.core.typing.templates import signature

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a successor of numba.pycc is promised
            from numba.pycc.compiler import ExportEntry, ModuleCompiler
    except ImportError:  # needs setuptools
        return False
    base = _base_object(compiler)
    if base is None:
        return False
    module = ModuleCompiler(
        [ExportEntry(_FUNCTION, signature(None, *map(numba.typeof, arguments)), function)],
        _MODULE,
        use_nrt=True,
        cpu_name=_processor_level(),
    )
    module.external_init_function = f"pycc_init_{_MODULE}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".building_") as folder:
            compiled, linked = os.path.join(folder, "code.o"), os.path.join(folder, "code.so")
            module.write_native_object(compiled, wrap=True)
            _run(compiler, "-shared", "-s", "-pthread", "-o", linked, compiled, base, "-lm")
            os.replace(linked, path)
    except OSError:
        return False
    name, source, _, _ = path.name.rsplit(".", 3)
    for other in path.parent.glob(f"{name}.*.so"):
        other_name, other_source, *_ = other.name.rsplit(".", 3)
        if other_name == name and other_source != source:
            other.unlink(missing_ok=True)
    return True


@functools.cache
def _base_object(compiler: str) -> str | None:
    """Return the object file with the parts of numba that each machine code needs; make it once.

    None if it cannot be compiled.
    """
    path = _cached(__file__, f"{_MODULE}.{_hash(_environment())}.o")
    if path.is_file():
        return str(path)
    import tempfile

    from numba.pycc.cc import CC

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".building_") as folder:
            # Private, as numba makes no files of these parts alone, which take two seconds.
            objects = CC(_MODULE, source_module=sys.modules[__name__])._compile_mixins(folder)
            joined = os.path.join(folder, "base.o")
            _run(compiler, "-r", "-nostdlib", "-o", joined, *objects)
            os.replace(joined, path)
    except Exception:  # setuptools has errors of its own
        return None
    return str(path)


def _run(*command: str) -> None:
    """Run a compiler; raise OSError if it fails."""
    import subprocess

    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise OSError(f"{command[0]}: {done.stderr}")


def _hash(parts: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
