"""Launch any system file: ``ros2 launch vtff_bringup system.launch.py system:=reference_software``.

Further ``name:=value`` arguments are those of the system file and ``node.parameter`` ones, given
as one text: ``overrides:='sdre_controller.design:=delay_aware'``.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from vtff_bringup.launch_system import launch_actions


def start(context):
    configuration = {
        name: LaunchConfiguration(name).perform(context)
        for name in ("system", "overrides", "pacing", "run_directory")
    }
    return launch_actions(**configuration)


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "system",
                default_value="reference_software",
                description="name of a file in config/system, or a path",
            ),
            DeclareLaunchArgument(
                "overrides", default_value="", description="key:=value texts, blank between them"
            ),
            DeclareLaunchArgument("pacing", default_value="lockstep", description="or realtime"),
            DeclareLaunchArgument(
                "run_directory", default_value="", description="default: bags/<system>_<date>"
            ),
            OpaqueFunction(function=start),
        ]
    )
