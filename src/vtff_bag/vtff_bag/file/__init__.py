"""ROS 2 bags (MCAP, rosbag2 metadata version 9), written and read without rosbag2."""
