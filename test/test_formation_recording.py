"""The input of the ionosphere processor, read back from a bag second by second."""

import pathlib

import pytest
from formation_recording import formation_seconds

from vtff_bag.file.reader import BagReader
from vtff_iono.conversions import block_from_messages

BAG = pathlib.Path(__file__).resolve().parents[1] / "bags" / "sample"


@pytest.fixture(scope="module")
def seconds():
    if not BAG.is_dir():
        pytest.skip("the sample bag is not there")
    return list(formation_seconds(BagReader(BAG)))


def test_a_second_holds_its_epochs(seconds):
    """The epochs after the end of the second before, up to its own end, as the node takes them."""
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
