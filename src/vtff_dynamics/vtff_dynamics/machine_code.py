"""Machine code of compiled functions as extension modules, which load without numba.

To import numba and to have it load a cached function takes half a second of processor; an extension
module is there after half a millisecond. numba makes both from the same intermediate code, so that
results are the same to the last bit.
"""

from __future__ import annotations

import contextlib
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
    "load_module_in_c",
    "machine_code_path",
    "source_fingerprint",
]

#: Name of all extension modules: the parts of numba that are linked to each refer to it.
_MODULE = "vtff_machine_code"
_FUNCTION = "call"
#: The look at arguments in C, which takes a tenth of the time of one in Python.
_DISPATCHER_SOURCE = pathlib.Path(__file__).with_name("argument_dispatcher.c")
_DISPATCHER_MODULE = "vtff_argument_dispatcher"
#: Without it machine code unpickles the class of each array that it returns.
_UNPICKLING_SOURCE = pathlib.Path(__file__).with_name("unpickle_once.c")
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
#: Kinds of numbers in arrays: floating, signed, unsigned, truth values, complex.
_KINDS = "fiubc"
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
        if argument.dtype.kind not in _KINDS or not argument.dtype.isnative or not flags.aligned:
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
    """Return a callable that calls the machine code for the forms of its arguments.

    It looks at them in C, or in Python where C cannot be compiled.

    Parameters
    ----------
    codes : dict
        Machine code by the forms of its arguments, of which all have one number. It does not look
        at them itself: an array of another kind would be read wrongly.
    otherwise : callable
        Called where no form matches.

    Raises
    ------
    ValueError
        If the numbers of arguments differ.
    """
    if len(set(map(len, codes))) != 1:
        raise ValueError("a compiled function has one number of arguments")
    make_dispatcher = _load_dispatcher()
    if make_dispatcher is None:
        return _python_dispatcher(codes, otherwise)
    entries = tuple((tuple(map(_look, forms)), code) for forms, code in codes.items())
    dispatcher: Callable[..., Any] = make_dispatcher(
        max(map(len, codes)), entries, otherwise, _argument_form
    )
    return dispatcher


@functools.cache
def _look(form: str) -> tuple[int, str, tuple[Any, ...]]:
    """Return what the dispatcher in C asks of an argument: kind, form, particulars of the kind."""
    if form in _SCALAR_TYPES:
        return 0, form, _SCALAR_TYPES[form]
    if form.endswith(")"):
        return 2, form, tuple(map(_look, _member_forms(form)))
    layout, name, dimensions, *readonly = form.split(" ")
    return 1, form, (_type_numbers(name), int(dimensions), layout, bool(readonly))


@functools.cache
def _type_numbers(name: str) -> int:
    """Return a bit for each of numpy's numbers of a data type: int64 is long and long long."""
    data_types = map(np.dtype, np.typecodes["All"])
    numbers = {each.num for each in data_types if each.kind in _KINDS and each.name == name}
    return sum(1 << number for number in numbers)


def _member_forms(form: str) -> list[str]:
    """Return the forms of the members of a named tuple."""
    forms, depth = [""], 0
    for character in form[form.index("(") + 1 : -1]:
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and not depth:
            forms.append("")
        else:
            forms[-1] += character
    return [member.strip().partition(" ")[2] for member in forms if member]


def _python_dispatcher(
    codes: dict[tuple[str, ...], Callable[..., Any]], otherwise: Callable[..., Any]
) -> Callable[..., Any]:
    """Return the function that `dispatching_function` describes, written in Python."""

    def dispatch(*arguments: Any) -> Any:
        forms = argument_forms(arguments)
        code = otherwise if forms is None else codes.get(forms, otherwise)
        return code(*arguments)

    return dispatch


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
        _UNPICKLING_SOURCE.read_text(encoding="utf-8"),
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
    module = _load_extension(_MODULE, path)
    function: Callable[..., Any] | None = getattr(module, _FUNCTION, None)
    return function


def _load_extension(name: str, path: pathlib.Path) -> types.ModuleType | None:
    """Return the extension module in a file; None if there is none or it cannot be loaded."""
    loader = importlib.machinery.ExtensionFileLoader(name, str(path))
    specification = importlib.util.spec_from_file_location(name, path, loader=loader)
    if specification is None or not path.is_file():
        return None
    try:
        module = importlib.util.module_from_spec(specification)
        loader.exec_module(module)
    except ImportError:
        return None
    return module


def build_machine_code(
    function: types.FunctionType, arguments: Sequence[Any], path: pathlib.Path
) -> bool:
    """Compile a function for arguments of some types into a file; tell whether that was possible.

    Parameters
    ----------
    function : function
        Functions that it calls are compiled by numba.
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

    compiler = _compiler()
    if compiler is None or shutil.which("c++") is None:
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
        with _building(path) as (folder, linked):
            compiled = os.path.join(folder, "code.o")
            module.write_native_object(compiled, wrap=True)
            options = ["-shared", "-s", "-pthread", "-Wl,--wrap=numba_unpickle"]
            _run(compiler, *options, "-o", linked, compiled, base, "-lm")
    except OSError:
        return False
    name, source, _, _ = path.name.rsplit(".", 3)
    for other in path.parent.glob(f"{name}.*.so"):
        other_name, other_source, *_ = other.name.rsplit(".", 3)
        if other_name == name and other_source != source:
            other.unlink(missing_ok=True)
    return True


@functools.cache
def _load_dispatcher() -> Callable[..., Any] | None:
    """Return what makes dispatchers in C, compiled where that is needed; None if it cannot be."""
    module = load_module_in_c(_DISPATCHER_MODULE, _DISPATCHER_SOURCE)
    make_dispatcher: Callable[..., Any] | None = getattr(module, "dispatcher", None)
    return make_dispatcher


def load_module_in_c(name: str, source: pathlib.Path) -> types.ModuleType | None:
    """Return a module written in C, compiled where that is needed; None if it cannot be.

    Parameters
    ----------
    name
        Name of the module; its initialisation is ``PyInit_<name>``.
    source
        File with the source, which may include the headers of Python and numpy.
    """
    try:
        text = source.read_text(encoding="utf-8")
        parts = (text, importlib.machinery.EXTENSION_SUFFIXES[0], np.__version__)
        path = _cached(str(source), f"{name}.{_hash(parts)}.so")
        module = _load_extension(name, path)
        if module is None:
            _build_module(source, path)
            module = _load_extension(name, path)
    except OSError:
        return None
    return module


def _build_module(source: pathlib.Path, path: pathlib.Path) -> None:
    """Compile a module in C into a file; raise OSError if that is impossible."""
    import sysconfig

    compiler = _compiler()
    if compiler is None:
        raise OSError("no compiler")
    folders = [sysconfig.get_paths()["include"], np.get_include()]
    with _building(path) as (_, linked):
        options = ["-O2", "-DNDEBUG", "-fPIC", "-shared", "-s", *(f"-I{name}" for name in folders)]
        _run(compiler, *options, "-o", linked, str(source))


def _compiler() -> str | None:
    """Return the path of the C compiler; None where it or the headers of Python are absent."""
    import shutil
    import sysconfig

    header = pathlib.Path(sysconfig.get_paths()["include"]) / "Python.h"
    return shutil.which("cc") if header.is_file() else None


@functools.cache
def _base_object(compiler: str) -> str | None:
    """Return the object file with the parts of numba that each machine code needs; make it once.

    None if it cannot be compiled.
    """
    path = _cached(__file__, f"{_MODULE}.{_hash(_environment())}.o")
    if path.is_file():
        return str(path)
    import sysconfig

    from numba.pycc.cc import CC

    try:
        with _building(path) as (folder, joined):
            # Private, as numba makes no files of these parts alone, which take two seconds.
            objects = CC(_MODULE, source_module=sys.modules[__name__])._compile_mixins(folder)
            unpickling = os.path.join(folder, "once.o")
            options = ["-O2", "-fPIC", f"-I{sysconfig.get_paths()['include']}"]
            _run(compiler, *options, "-c", "-o", unpickling, str(_UNPICKLING_SOURCE))
            _run(compiler, "-r", "-nostdlib", "-o", joined, *objects, unpickling)
    except Exception:  # setuptools has errors of its own
        return None
    return str(path)


@contextlib.contextmanager
def _building(path: pathlib.Path) -> Iterator[tuple[str, str]]:
    """Yield a folder, which does not last, and a file in it that becomes the path at the end.

    No process ever sees a part of that file. After an error there is none.
    """
    import tempfile

    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".building_") as folder:
        made = os.path.join(folder, "made")
        yield folder, made
        os.replace(made, path)


def _run(*command: str) -> None:
    """Run a compiler; raise OSError if it fails."""
    import subprocess

    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise OSError(f"{command[0]}: {done.stderr}")


def _hash(parts: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
