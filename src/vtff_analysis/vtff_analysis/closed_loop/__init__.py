"""Truth, controller and thruster in one process, without ROS: the fast twin of the node graph."""
