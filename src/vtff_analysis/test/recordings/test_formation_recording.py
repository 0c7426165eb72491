"""What the ionosphere processor was given, read back; many seconds at once or one by one."""

import dataclasses
import pathlib

import numpy as np
import pytest

from vtff_analysis.recordings.formation_recording import formation_seconds
from vtff_bag.file.reader import BagReader
from vtff_iono.conversions import block_from_messages
from vtff_iono.formation_ionosphere import FormationIonosphere

BAG = pathlib.Path(__file__).resolve().parents[4] / "bags" / "sample"


@pytest.fixture(scope="module")
def seconds():
    if not BAG.is_dir():
        pytest.skip("the sample bag is not there")
    return list(formation_seconds(BagReader(BAG)))


def leaves(value):
    """Yield arrays and numbers of nested results as bytes and texts."""
    if isinstance(value, np.ndarray):
        yield value.dtype.str, value.tobytes()
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from leaves(getattr(value, field.name))
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from leaves(item)
    else:
        yield repr(value)


def test_many_seconds_at_once_give_the_same_bytes_as_one_by_one(seconds):
    one_by_one, at_once = FormationIonosphere(), FormationIonosphere()
    results = at_once.process_recording(seconds)
    for (ephemerides, second), found in zip(seconds, results, strict=True):
        for ephemeris in ephemerides:
            one_by_one.add_ephemeris(ephemeris)
        expected = one_by_one.process(second)
        assert list(leaves(found)) == list(leaves(expected)), second.time
        assert found.spacecraft[0].epoch is not None


def test_a_second_holds_its_epochs(seconds):
    """Those after the second before, up to its own, as the node takes them."""
    reader = BagReader(BAG)
    by_second = {}
    for item in reader.messages("/deputy/gnss/high_rate"):
        stamp = item.message.header.stamp
        end = stamp.sec + (stamp.nanosec > 0)
        by_second.setdefault(end, []).append(item.message)
    assert len(by_second) == len(seconds)
    for messages, (_, second) in zip(by_second.values(), seconds, strict=True):
        expected = block_from_messages(messages)
        found = second.observations[1]
        assert found.time.tolist() == expected.time.tolist()
        for name, column in expected.columns.items():
            assert found.columns[name].dtype == column.dtype
            assert found.columns[name].tobytes() == column.tobytes(), name
