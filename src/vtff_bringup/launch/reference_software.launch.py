"""Launch the reference formation with truth fed to the controller."""

from vtff_bringup.run.launch_description import launch_description


def generate_launch_description():
    return launch_description(system="reference_software")
