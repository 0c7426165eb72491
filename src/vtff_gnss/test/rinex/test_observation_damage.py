"""Damaged observation files: the clear error or the intact beginning, never anything else."""

from __future__ import annotations

import functools

import hatanaka
import numpy as np
import pytest
from gnss_test_support import examples
from hypothesis import given
from hypothesis import strategies as st
from rinex_test_support import epoch_3, header_2, header_3, header_line, types_3, value

from vtff_gnss.constants import FLAG_LOCK_LOST
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.observation import parse_rinex_observation


@functools.cache
def sample(version: int) -> bytes:
    """Return a file of 20 epochs of six satellites, some values of which are missing."""
    generator = np.random.default_rng(version)
    date = header_line("", "PGM / RUN BY / DATE")
    types = ("C1", "L1", "D1", "S1", "P2", "L2", "S2")
    if version == 2:
        text = header_2(*types, system="G")
    else:
        text = header_3(types_3("G", "C1C", "L1C", "D1C", "S1C", "C2W", "L2W", "S2W"))
    first, rest = text.split("\n", 1)
    text = first + "\n" + date + rest
    satellites = [f"G{n:02d}" for n in range(1, 7)]
    for second in range(20):
        if version == 2:
            text += f" 24  1 10  0  0{second:11.7f}  0  6{''.join(satellites)}\n"
        else:
            text += epoch_3(second, 6)
        for name in satellites:
            numbers = generator.uniform(2.0e7, 2.6e7, 7)
            cells = [value(x if generator.random() > 0.1 else None) for x in numbers]
            if version == 2:
                text += "".join(cells[:5]).rstrip() + "\n" + "".join(cells[5:]).rstrip() + "\n"
            else:
                text += (name + "".join(cells)).rstrip() + "\n"
    return text.encode("ascii")


@functools.cache
def intact(version: int):
    return list(parse_rinex_observation(sample(version), "sample").epochs())


@pytest.mark.parametrize("year", ["240", "9999", "1969"])
def test_a_year_that_cannot_be_counted_is_refused(year):
    """Times are ns in 64 bits; a fuzzer has found the year 240."""
    text = header_2("C1") + f"{year} 1 10  0  0  0.0000000  0  1G05\n" + value(2e7) + "\n"
    text = text.replace("9999 1 10", "9999 1 1")
    with pytest.raises(RinexError, match="epoch"):
        parse_rinex_observation(text.encode(), "fuzz.rnx")


@pytest.mark.parametrize("version", [2, 3])
@given(where=st.floats(0.0, 1.0))
@examples(150)
def test_a_truncated_file_gives_the_error_or_the_beginning(version, where):
    content = sample(version)
    cut = content[: int(where * len(content))]
    try:
        result = parse_rinex_observation(cut, "sample", partial=True)
    except RinexError as error:
        # Without a whole header.
        assert b"END OF HEADER\n" not in cut and "sample" in str(error)
        return
    found = list(result.epochs())
    assert found == intact(version)[: len(found)]
    complete = cut.count(b"> 2024") if version == 3 else cut.count(b" 24  1 10")
    assert complete - 1 <= len(found) <= complete


@pytest.mark.parametrize("version", [2, 3])
@given(st.data())
@examples(200)
def test_mangled_bytes_never_give_another_exception(version, data):
    content = bytearray(sample(version))
    header_length = content.index(b"END OF HEADER") if data.draw(st.booleans()) else 0
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(header_length, len(content) - 1))
        kind = data.draw(st.sampled_from(["replace", "delete", "insert"]))
        garbage = data.draw(st.binary(min_size=1, max_size=20) | st.just(b"\n"))
        if kind == "replace":
            content[place : place + len(garbage)] = garbage
        elif kind == "delete":
            del content[place : place + len(garbage)]
        else:
            content[place:place] = garbage
    try:
        table = parse_rinex_observation(bytes(content), "sample", partial=True).table
    except RinexError as error:
        assert "sample" in str(error)
        return
    assert table.first_row[-1] == len(table.columns["prn"])
    assert (np.diff(table.time_nanoseconds) > 0).all()


@given(st.binary(max_size=400))
@examples(200)
def test_arbitrary_bytes_are_refused(content):
    with pytest.raises(RinexError, match="sample"):
        parse_rinex_observation(content, "sample")


@pytest.mark.parametrize("compression", ["none", "gz", "bz2", "Z"])
@given(where=st.floats(0.0, 0.999))
@examples(25)
def test_truncated_compact_files_are_refused(compression, where):
    packed = _packed(compression)
    cut = packed[: int(where * len(packed))]
    try:
        result = parse_rinex_observation(cut, "sample")
    except RinexError as error:
        assert "sample" in str(error)
        return
    # Cut between two epochs, where nothing is missing that the format announces.
    found = list(result.epochs())
    assert found == intact(3)[: len(found)]


@functools.cache
def _packed(compression: str) -> bytes:
    return hatanaka.compress(sample(3), compression=compression)


def _with_count(version: int, epoch: int, count: int) -> bytes:
    """Return the sample with another number of satellites in one of its epochs."""
    lines = sample(version).decode("ascii").splitlines(keepends=True)
    starts = [i for i, line in enumerate(lines) if line.startswith(("> 2024", " 24  1 10"))]
    line = lines[starts[epoch]]
    column = line.rindex("  6") if version == 3 else line.index("  6G01")
    lines[starts[epoch]] = f"{line[:column]}{count:3d}{line[column + 3 :]}"
    return "".join(lines).encode("ascii")


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("count", [0, 3, 5, 7, 8, 13, 30, 999])
@pytest.mark.parametrize("epoch", [0, 1, 10, 18])
def test_a_wrong_number_of_satellites_costs_its_epoch(version, count, epoch):
    result = parse_rinex_observation(_with_count(version, epoch, count), "sample")
    expected = [e for i, e in enumerate(intact(version)) if i != epoch]
    assert [e.time for e in result.epochs()] == [e.time for e in expected]
    for actual, wanted in zip(result.epochs(), expected, strict=True):
        np.testing.assert_array_equal(actual.pseudorange, wanted.pseudorange)
    (remark,) = result.remarks
    assert remark.startswith("1 damaged epoch is left out, the first: sample:")
    # The satellites that are there again have been out of sight for one epoch.
    if epoch:
        assert (result.table.columns["flags"] & FLAG_LOCK_LOST).any()


@pytest.mark.parametrize("version", [2, 3])
def test_all_damaged_epochs_are_counted(version):
    content = _with_count(version, 3, 5)
    marks = (b"> 2024", b" 24  1 10")
    lines = content.splitlines(keepends=True)
    starts = [i for i, line in enumerate(lines) if line.startswith(marks)]
    lines[starts[7]] = lines[starts[7]][:10] + b"x" + lines[starts[7]][11:]
    result = parse_rinex_observation(b"".join(lines), "sample")
    assert len(result.table) == 18
    (remark,) = result.remarks
    assert remark.startswith(f"2 damaged epochs are left out, the first: sample:{starts[3] + 1}:")
