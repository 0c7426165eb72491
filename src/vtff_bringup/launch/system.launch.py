"""Launch any system file: ``ros2 launch vtff_bringup system.launch.py system:=reference_software``.

``overrides:='scenario:=my.yaml sdre_controller.design:=delay_aware'`` gives arguments of the
system file and parameters of nodes; ``ros2 launch --show-args`` lists the other arguments.
"""

from vtff_bringup.run.launch_description import launch_description


def generate_launch_description():
    return launch_description()
