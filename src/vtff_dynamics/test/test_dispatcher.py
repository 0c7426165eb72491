"""Dispatchers: machine code is called for arguments of its forms only, looked at in C or Python."""

import collections
import contextlib
import enum
import gc
import pathlib
import pickle
import sys
import tracemalloc
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_dynamics import machine_code
from vtff_dynamics.machine_code import argument_forms, dispatching_function


@pytest.fixture(params=["C", "Python"])
def language(request, monkeypatch):
    """Look at arguments in each language; without a compiler it is Python."""
    if request.param == "Python":
        monkeypatch.setattr(machine_code, "_load_dispatcher", lambda: None)
    else:
        assert machine_code._load_dispatcher() is not None
    return request.param


Pair = collections.namedtuple("Pair", "first second")
MATRIX = np.zeros((3, 4))


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


FORMS = [
    (1.0, "float"),
    (np.float64(1.0), "float"),
    (1, "int"),
    (np.int64(1), "int"),
    (True, "bool"),
    (np.bool_(True), "bool"),
    (MATRIX, "C float64 2"),
    (MATRIX.T, "F float64 2"),
    (MATRIX[:, ::2], "A float64 2"),
    (read_only(MATRIX), "C float64 2 readonly"),
    (np.zeros(3, dtype=np.uint8), "C uint8 1"),
    (np.zeros(3, dtype=np.float32), "C float32 1"),
    (Pair(1.0, 2), f"{__name__}.Pair(first float, second int)"),
    (Pair(1.0, MATRIX), f"{__name__}.Pair(first float, second C float64 2)"),
]


@pytest.mark.parametrize(("argument", "form"), FORMS)
def test_code_is_called_for_arguments_of_its_form_only(argument, form, language):
    assert argument_forms([argument]) == (form,)
    dispatch = dispatching_function({(form,): lambda value: "code"}, lambda value: "otherwise")
    for other, other_form in FORMS:
        assert dispatch(other) == ("code" if other_form == form else "otherwise"), other_form


@pytest.mark.parametrize(
    "argument",
    [
        None,
        "text",
        (1.0, 2.0),
        Pair(1.0, None),
        np.float32(1.0),
        np.zeros(3, dtype=">f8"),
        np.zeros(2, dtype=[("x", "u1"), ("y", "f8")]),
        np.zeros(2, dtype=[("x", "u1"), ("y", "f8")])["y"],
        np.array(["text"]),
        np.zeros(3).view(np.recarray),
    ],
)
def test_other_arguments_have_no_form(argument, language):
    assert argument_forms([argument]) is None
    dispatch = dispatching_function(
        {(form,): lambda value: "code" for _, form in FORMS}, lambda value: "otherwise"
    )
    assert dispatch(argument) == "otherwise"


class Named(enum.IntEnum):
    ONE = 1


class Length(float):
    pass


class Row(np.ndarray):
    pass


class Unfinished(tuple):
    """Looks like a named tuple, but may lack a member."""

    _fields = ("first", "second")


Empty = collections.namedtuple("Empty", "")
Nested = collections.namedtuple("Nested", "pair rest")
#: Classes of their own, but with the forms of those above.
OTHER_PAIR = collections.namedtuple("Pair", "first second", module=__name__)
OTHER_FIELDS = collections.namedtuple("Pair", "second first", module=__name__)

HALVES = np.dtype((np.int32, {"low": (np.int16, 0), "high": (np.int16, 2)}))
SWAPPED_HALVES = np.dtype((np.int32, {"low": (">i2", 0), "high": (">i2", 2)}))
DATA_TYPES = [
    *(np.dtype(code) for code in np.typecodes["All"] if code not in "SUVOMm"),
    *(np.dtype(np.float64).newbyteorder(order) for order in "<>"),
    *(np.dtype(np.int64).newbyteorder(order) for order in "<>"),
    np.dtype(">c16"),
    pickle.loads(pickle.dumps(np.dtype("f8"))),
    np.dtype("f8", metadata={"unit": "m"}),
    np.dtype("f8", align=True, copy=True),
    HALVES,
    SWAPPED_HALVES,
    *map(np.dtype, ("S3", "U2", "O", "V8", "M8[s]", "m8[ns]")),
    np.dtype([("x", "u1"), ("y", "f8")]),
]
CHANGES = {
    "plain": lambda array: array,
    "Fortran": np.asfortranarray,
    "transposed": np.transpose,
    "every other": lambda array: array[..., ::2] if array.ndim else array,
    "backwards": lambda array: array[::-1] if array.ndim else array,
    "broadcast": lambda array: np.broadcast_to(array, (2, *array.shape)),
    "read only": read_only,
    "unaligned": lambda array: (
        np.frombuffer(bytearray(array.nbytes + 1), np.uint8, array.nbytes, 1)
        .view(array.dtype)
        .reshape(array.shape)
        if array.size and not array.dtype.hasobject
        else array
    ),
    "swapped in place": lambda array: array.view(array.dtype.newbyteorder()),
    "row": lambda array: array.view(Row),
    "masked": np.ma.asarray,
    "back to plain": lambda array: array.view(Row).view(np.ndarray),
}


@st.composite
def arrays(draw):
    shape = draw(st.lists(st.integers(0, 3), max_size=3))
    array = np.zeros(shape, draw(st.sampled_from(DATA_TYPES)))
    for change in draw(st.lists(st.sampled_from(sorted(CHANGES)), max_size=2)):
        array = CHANGES[change](array)
    return array


SCALARS = [
    *(0.0, 1, True, 2**63, -(2**70), 1j, None, "text", b"1", (1.0, 2), [1.0], Length(1.0)),
    *(Named.ONE, Empty(), float, np.dtype("f8"), np.bool_(1), np.longdouble(1)),
    *(kind(1) for kind in (np.float32, np.float64, np.int32, np.int64, np.longlong, np.uint64)),
]
PLAIN = st.one_of(
    st.sampled_from(SCALARS),
    arrays(),
    # Ordinary forms, so that many are met twice.
    st.sampled_from([MATRIX, MATRIX.T, MATRIX[:, ::2], MATRIX[0], MATRIX[:, 0], MATRIX[:0]]),
)
ARGUMENTS = st.recursive(
    PLAIN,
    lambda inner: st.builds(
        lambda kind, first, second: kind(first, second),
        st.sampled_from([Pair, OTHER_PAIR, OTHER_FIELDS, Nested]),
        inner,
        inner,
    ),
    max_leaves=4,
)


@settings(max_examples=150, deadline=None)
@given(st.lists(ARGUMENTS, min_size=2, max_size=12), st.data())
def test_looks_in_c_accept_what_argument_forms_does(arguments, data):
    forms = [argument_forms([argument]) for argument in arguments]
    known = sorted({form for form in forms if form is not None})
    dispatch = dispatching_function(
        {form: lambda value, form=form: (form, value) for form in known} or {("float",): tuple},
        lambda value: (None, value),
    )
    for _ in range(2):  # classes of named tuples are remembered
        for argument, form in zip(arguments, forms, strict=True):
            found, passed = dispatch(argument)
            assert found == form and passed is argument
    # One dispatcher for each: what it refuses goes to the other function.
    for form in known:
        alone = dispatching_function({form: lambda value: True}, lambda value: False)
        for argument, other in zip(arguments, forms, strict=True):
            assert alone(argument) == (other == form), (argument, other, form)
    first, second = data.draw(st.sampled_from(arguments)), data.draw(st.sampled_from(arguments))
    both = argument_forms([first, second])
    if both is not None:
        pairs = dispatching_function({both: lambda *values: True}, lambda *values: False)
        for one, one_form in zip(arguments, forms, strict=True):
            for two, two_form in zip(arguments, forms, strict=True):
                assert pairs(one, two) == ((one_form or ()) + (two_form or ()) == both)


def test_every_data_type_and_layout_against_every_other():
    arguments = []
    for data_type in DATA_TYPES:
        for shape in ((), (0,), (3,), (2, 3), (1, 3), (2, 0)):
            plain = np.zeros(shape, data_type)
            arguments += [change(plain) for change in CHANGES.values()]
    forms = [argument_forms([argument]) for argument in arguments]
    assert {"C", "F", "A"} == {form[0][0] for form in forms if form}
    for known in sorted({form for form in forms if form}):
        dispatch = dispatching_function({known: lambda value: True}, lambda value: False)
        found = [form for form, value in zip(forms, arguments, strict=True) if dispatch(value)]
        assert found == [form for form in forms if form == known]


def codes_and_calls():
    """Return a dispatcher of two arguments, its functions, and arguments for each way through it.

    The last ways raise.
    """

    def fails(first, second):
        raise ArithmeticError("in machine code")

    codes = {
        argument_forms([MATRIX, 1.0]): lambda first, second: (first, second),
        argument_forms([Pair(1.0, MATRIX), 1]): lambda first, second: (first, second),
        argument_forms([np.zeros(2, HALVES), 1]): lambda first, second: (first, second),
        argument_forms([1.0, 1.0]): fails,
    }

    def otherwise(first, second):
        return first, second

    calls = [
        (MATRIX, 1.0),
        (Pair(1.0, MATRIX), 1),
        (OTHER_PAIR(1.0, MATRIX), 1),
        (np.zeros(2, HALVES), 1),
        (np.zeros(2, SWAPPED_HALVES), 1),
        (MATRIX.T, None),
        (1.0, 1.0),
        (Unfinished((1.0,)), 1),
        (MATRIX,),
    ]
    return codes, otherwise, calls


def call(dispatch, arguments):
    try:
        return dispatch(*arguments)
    except (ArithmeticError, ValueError, TypeError) as error:
        return type(error)


def test_errors_reach_the_caller(language):
    codes, otherwise, calls = codes_and_calls()
    dispatch = dispatching_function(codes, otherwise)
    with pytest.raises(ArithmeticError, match="in machine code"):
        dispatch(1.0, 1.0)
    with pytest.raises(ValueError, match="shorter"):
        dispatch(Unfinished((1.0,)), 1)
    # Also when its class is known, which the dispatcher in C does not ask about again.
    first_form = argument_forms([Unfinished((1.0, MATRIX))])
    known = dispatching_function({first_form: lambda value: "code"}, lambda value: "otherwise")
    assert known(Unfinished((1.0, MATRIX))) == "code"
    for members in ((), (1.0,), (1.0, MATRIX, 1.0)):
        with pytest.raises(ValueError, match="shorter|longer"):
            known(Unfinished(members))
    for arguments in ((), (1.0,), (1.0, 1.0, 1.0)):
        with pytest.raises(TypeError):
            dispatch(*arguments)
    with pytest.raises(TypeError):
        dispatch(1.0, 1.0, key=1.0)
    assert call(dispatch, calls[0]) == calls[0]


@pytest.mark.parametrize(
    "codes", [{("float",): len, ("float", "int"): len}, {("float", "int"): len, ("float",): len}]
)
def test_a_function_has_one_number_of_arguments(codes, language):
    with pytest.raises(ValueError, match="argument"):
        dispatching_function(codes, len)


def test_calls_in_c_keep_no_references():
    codes, otherwise, calls = codes_and_calls()
    dispatch = dispatching_function(codes, otherwise)
    watched = [Pair, OTHER_PAIR, otherwise, machine_code._argument_form, np.ndarray, None, float]
    watched += [*codes.values(), *codes]
    watched += [argument for arguments in calls for argument in arguments]

    def references():
        return [sys.getrefcount(value) for value in watched]

    for arguments in calls:
        call(dispatch, arguments)  # the class of a named tuple is remembered
        before = references()
        for _ in range(500):
            call(dispatch, arguments)
        # The interpreter's own constants have other users, which come and go.
        changes = [after - old for after, old in zip(references(), before, strict=True)]
        assert max(map(abs, changes)) < 10, (arguments, changes)


def test_dispatchers_in_c_are_freed_with_all_that_they_hold():
    codes, otherwise, calls = codes_and_calls()
    watched = [Pair, float, machine_code._argument_form, otherwise, *codes.values()]

    make = machine_code._load_dispatcher()
    half_read = (((1, "C float64 1", (1 << 12, 1, "C", False)), (0, "int", (int,))), len)

    def make_and_forget():
        for _ in range(200):
            dispatch = dispatching_function(codes, otherwise)
            for arguments in calls:
                call(dispatch, arguments)
            with contextlib.suppress(TypeError):
                make(2, (half_read,), otherwise, len)

    kept, references = [], []
    tracemalloc.start()
    try:
        for _ in range(4):
            make_and_forget()
            gc.collect()
            kept.append(tracemalloc.get_traced_memory()[0])
            references.append([sys.getrefcount(value) for value in watched])
    finally:
        tracemalloc.stop()
    # What leaks does so in each round: 200 times 64 bytes at least, and 200 references.
    assert min(np.diff(kept)) < 5000, kept
    assert np.all(np.min(np.diff(references, axis=0), axis=0) < 50), references


def test_a_circle_through_a_dispatcher_in_c_is_collected():
    class Owner:
        def otherwise(self, value):
            return value

    owner = Owner()
    owner.dispatch = dispatching_function({("float",): abs}, owner.otherwise)
    assert (owner.dispatch(-1.0), owner.dispatch("text")) == (1.0, "text")
    gone = weakref.ref(owner)
    del owner
    gc.collect()
    assert gone() is None


def test_the_dispatcher_in_c_is_made_anew_when_its_source_or_numpy_changes(tmp_path, monkeypatch):
    load = machine_code._load_dispatcher.__wrapped__
    cache = tmp_path / "cache"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    run, commands = machine_code._run, []

    def count(*command):
        commands.append(command)
        run(*command)

    monkeypatch.setattr(machine_code, "_run", count)
    assert load()(1, (), len, len)([1, 2, 3]) == 3
    assert load() is not None
    assert len(commands) == len(list(cache.iterdir())) == 1, "the second comes from the file"

    source = pathlib.Path(machine_code._DISPATCHER_SOURCE).read_text(encoding="utf-8")
    changed = tmp_path / "argument_dispatcher.c"
    changed.write_text(source + "\n/* Changed. */\n", encoding="utf-8")
    monkeypatch.setattr(machine_code, "_DISPATCHER_SOURCE", changed)
    assert load() is not None
    assert len(commands) == len(list(cache.iterdir())) == 2

    monkeypatch.setattr(np, "__version__", "2.99")
    changed.write_text("#error numpy", encoding="utf-8")
    assert load() is None, "a compiler that fails"
    assert len(commands) == 3

    monkeypatch.setenv("PATH", str(tmp_path))
    assert load() is None, "no compiler"
    changed.unlink()
    assert load() is None, "no source"
    assert len(commands) == 3
