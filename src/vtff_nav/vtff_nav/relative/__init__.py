"""Relative navigation of two receivers: estimators and integer ambiguities, without ROS."""
