"""Nights of drifting bubbles and a closed loop without ROS, for bench_survey.py."""
