"""The sample bag of the repository: whole, small, current, free of paths of a machine."""

import pathlib
import re

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from vtff_analysis.recordings.recording import read_run  # noqa: E402
from vtff_bag.file.reader import BagReader  # noqa: E402
from vtff_bag.player.messages_in_order import select_topics  # noqa: E402

REPOSITORY = pathlib.Path(__file__).resolve().parents[4]
SAMPLE = REPOSITORY / "bags" / "sample"
MACHINE_PATH = re.compile(rb"(?<![\w.$}/])/(?:home|root|Users|work|opt)/\w")


@pytest.fixture(scope="module")
def reader():
    return BagReader(SAMPLE)


def test_it_is_whole_and_small(reader):
    assert reader.complete, reader.notes
    assert sum(file.stat().st_size for file in reader.files) < 5_000_000


def test_it_fits_the_installed_messages(reader):
    selection = select_topics(reader)
    assert selection.skipped == (), "record the sample again, see bags/README.md"
    assert {"/chief/gnss/epoch", "/deputy/gnss/high_rate", "/deputy/relative_state"} <= set(
        selection.topics
    )


def test_it_holds_no_paths_of_a_machine(reader):
    texts = [text.encode() for text in reader.custom_data.values()]
    for text in (*texts, *(message.serialized for message in reader.raw_messages())):
        assert not MACHINE_PATH.search(text)


def test_it_is_described_as_it_is(reader):
    described = (REPOSITORY / "bags" / "README.md").read_text(encoding="utf-8")
    filled = [topic for topic in reader.topics.values() if topic.message_count]
    assert f"{len(reader.topics)} topics, {reader.message_count:,} messages" in described
    assert len(filled) >= 19


def test_it_has_what_a_report_wants():
    history = read_run(SAMPLE)
    assert history.notes == ()
    assert history.deputies["deputy"].estimate is not None
    assert set(history.receivers) == {"chief", "deputy"}
    assert history.health and history.compute_time and history.slant_tec
