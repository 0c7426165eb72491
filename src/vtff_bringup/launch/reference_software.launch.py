"""Launch the reference formation with truth fed to the controller."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from vtff_bringup.launch_system import launch_actions


def generate_launch_description():
    return LaunchDescription(
        [OpaqueFunction(function=lambda context: launch_actions(system="reference_software"))]
    )
