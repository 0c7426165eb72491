"""Environment variables by which `vtff run` tells the processes of a run where they are.

Without ROS: the program that starts the processes needs neither rclpy nor messages.
"""

from __future__ import annotations

__all__ = ["PROGRESS_VARIABLE", "RUN_DIRECTORY_VARIABLE"]

#: Folder of the current run; nodes leave their message counts there.
RUN_DIRECTORY_VARIABLE = "VTFF_RUN_DIRECTORY"
#: File descriptor for progress lines (JSON).
PROGRESS_VARIABLE = "VTFF_PROGRESS_FD"
