"""Studies on many runs: the closed loop without ROS, tables of cases, and two of the paper."""
