"""Comparison of recomputed with recorded outputs of nodes."""

from __future__ import annotations

import dataclasses
import json
import pathlib
from collections.abc import Iterable

from vtff_bag.file.message_content import have_equal_content
from vtff_bag.file.reader import BagReader, RawMessage
from vtff_bag.run.description import PARAMETER_FOLDER, describe_run
from vtff_bringup.run.runner import NODE_RECORDS

#: Topics on which nodes report about themselves; they contain wall times.
REPORTS = frozenset(("/diagnostics", "/sim/step_done", "/rosout", "/clock"))


@dataclasses.dataclass(frozen=True)
class OutputComparison:
    """Comparison of a recomputed topic with the recorded one.

    Attributes
    ----------
    topic
        Name of the topic.
    recorded, recomputed
        Number of messages in the two bags.
    differing
        Number of messages that differ from the message with the same index in a bit of a field.
    first_difference
        Time of the first difference, s since the begin of the recording; None without one.
    """

    topic: str
    recorded: int
    recomputed: int
    differing: int
    first_difference: float | None

    @property
    def identical(self) -> bool:
        """Whether both bags hold the same messages."""
        return self.recorded == self.recomputed and not self.differing


def recomputed_topics(run_directory: pathlib.Path, replaying: Iterable[str]) -> list[str]:
    """Return the topics that the nodes of a run published, except those that replay or record.

    Parameters
    ----------
    run_directory
        Folder of the run with the message counts of each node.
    replaying
        Fully qualified names of the nodes that are left out.
    """
    left_out = set(replaying)
    topics: set[str] = set()
    for path in sorted((run_directory / NODE_RECORDS).glob("*.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["node"] not in left_out:
            topics.update(record["published"])
    return sorted(topics - REPORTS)


def compare_outputs(
    recorded: BagReader, recomputed: BagReader, topics: Iterable[str]
) -> list[OutputComparison]:
    """Compare topics of two bags bit by bit, in the order in which messages are stored."""
    return [_compare_topic(recorded, recomputed, topic) for topic in topics]


def _compare_topic(recorded: BagReader, recomputed: BagReader, topic: str) -> OutputComparison:
    before, after = _messages(recorded, topic), _messages(recomputed, topic)
    differences = [
        old.log_time
        for old, new in zip(before, after, strict=False)
        if not have_equal_content(bytes(old.serialized), bytes(new.serialized), old.type)
    ]
    first = (differences[0] - recorded.start_time) * 1e-9 if differences else None
    return OutputComparison(topic, len(before), len(after), len(differences), first)


def _messages(reader: BagReader, topic: str) -> list[RawMessage]:
    return list(reader.raw_messages([topic])) if topic in reader.topics else []


def carry_over_parameters(recorded: BagReader, run_directory: pathlib.Path) -> None:
    """Write the recorded parameters into the new run folder; nodes that run again replace theirs.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    described = describe_run(recorded.path.parent, recorded.custom_data)
    folder = run_directory / PARAMETER_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in described.parameter_texts.items():
        (folder / f"{pathlib.PurePath(name).name}.yaml").write_text(text, encoding="utf-8")
