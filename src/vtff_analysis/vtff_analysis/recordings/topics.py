"""Names of the topics that are read from bags of every system, and names as parts of keys."""

from __future__ import annotations

import re

#: vtff_msgs/RelativeState in the namespace of a deputy -> what it is.
_RELATIVE_STATES = {
    "relative_state_truth": "truth",
    "relative_state": "estimate",
    "target": "target",
}
_RELATIVE_TOPIC = re.compile(rf"^/(?P<deputy>.+)/(?P<name>{'|'.join(_RELATIVE_STATES)})$")

#: vtff_msgs/SimulatorStatus.
STATUS_TOPIC = "/sim/status"

#: Names of the spacecraft of the shipped formations of two: the namespaces of their topics.
CHIEF, DEPUTY = "chief", "deputy"


def truth_topic(deputy: str) -> str:
    """Return the topic of the true relative state of a deputy."""
    return f"/{deputy}/relative_state_truth"


def relative_state_topic(topic: str) -> tuple[str, str] | None:
    """Return deputy and kind of a topic of relative states; None for any other topic.

    The kind is ``truth``, ``estimate`` (of navigation) or ``target``.
    """
    match = _RELATIVE_TOPIC.match(topic)
    return None if match is None else (match["deputy"], _RELATIVE_STATES[match["name"]])


def key_part(name: str) -> str:
    """Return a topic or spacecraft name as part of a key: ``/sim/status`` -> ``sim_status``."""
    return name.strip("/").replace("/", "_").lower()
