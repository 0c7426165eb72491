"""Names of the topics that are read from bags whatever system was run."""

from __future__ import annotations

#: vtff_msgs/RelativeState of a deputy: true, from navigation, wanted.
TRUTH_TOPIC = "/formation/relative_state_truth"
ESTIMATE_TOPIC = "/formation/relative_state"
TARGET_TOPIC = "/formation/target"

#: vtff_msgs/SimulatorStatus, and its STATE_ENDED, for readers without ROS.
STATUS_TOPIC = "/sim/status"
STATE_ENDED = 5
