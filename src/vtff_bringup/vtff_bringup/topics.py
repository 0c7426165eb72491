"""Names of the topics that report and viewer read whatever system was run."""

from __future__ import annotations

#: vtff_msgs/RelativeState of a deputy: true, from navigation, wanted.
TRUTH_TOPIC = "/formation/relative_state_truth"
ESTIMATE_TOPIC = "/formation/relative_state"
TARGET_TOPIC = "/formation/target"
