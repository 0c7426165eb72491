"""Names of the topics that are read from bags of every system, and names as parts of keys."""

from __future__ import annotations

#: vtff_msgs/RelativeState of a deputy: the truth, the estimate of navigation, the target.
TRUTH_TOPIC = "/formation/relative_state_truth"
ESTIMATE_TOPIC = "/formation/relative_state"
TARGET_TOPIC = "/formation/target"

#: vtff_msgs/SimulatorStatus.
STATUS_TOPIC = "/sim/status"

#: Names of the spacecraft of a formation of two: the namespaces of their topics.
CHIEF, DEPUTY = "chief", "deputy"


def key_part(name: str) -> str:
    """Return a topic or spacecraft name as part of a key: ``/sim/status`` -> ``sim_status``."""
    return name.strip("/").replace("/", "_").lower()
