"""Build description of vtff_control."""

from setuptools import find_packages, setup

package_name = "vtff_control"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    package_data={package_name: ["py.typed"]},
    install_requires=[
        "numpy>=1.26,<3",
        "scipy>=1.11,<2",
        "python-can[multicast]>=4.6,<5",
        "cantools>=40,<46",
        "crccheck>=1.3,<2",
        "cvxpy>=1.6,<2",
        "clarabel>=0.9,<1",
        "vtff_dynamics==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="Formation controller and thrusters.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "adcs_can = vtff_control.adcs_can_node:main",
            "attitude_controller = vtff_control.attitude_controller_node:main",
            "cluster_guidance = vtff_control.cluster_guidance_node:main",
            "formation_guidance = vtff_control.formation_guidance_node:main",
            "formation_safety = vtff_control.formation_safety_node:main",
            "sdre_controller = vtff_control.sdre_controller_node:main",
            "survey_guidance = vtff_control.survey_guidance_node:main",
            "thrust_allocation = vtff_control.thrust_allocation_node:main",
            "thruster_can = vtff_control.thruster_can_node:main",
            "thruster_model = vtff_control.thruster_model_node:main",
        ],
        "vtff.controllers": [
            "delay_aware = vtff_control.tracking.designs:DelayAwareController",
            "navigation_aware = vtff_control.tracking.designs:NavigationAwareController",
            "paper = vtff_control.tracking.designs:PaperController",
            "state_dependent = vtff_control.tracking.designs:StateDependentController",
        ],
        "vtff.guidances": [
            "formation = vtff_control.guidance.formation_guidance:FormationGuidance",
        ],
    },
)
