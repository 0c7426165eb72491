"""Build description of vtff_sim_bridge."""

from setuptools import find_packages, setup

package_name = "vtff_sim_bridge"

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
        "vtff_dynamics==0.1.0",
        "vtff_gnss==0.1.0",
        "vtff_node==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="Bridge to Spirent SimGEN over SimREMOTE, and an emulator of it.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "adcs_emulator = vtff_sim_bridge.adcs_emulator_node:main",
            "can_thruster_emulator = vtff_sim_bridge.thruster.can_thruster_emulator:main",
            "laser_emulator = vtff_sim_bridge.laser_emulator_node:main",
            "on_board_emulator = vtff_sim_bridge.on_board_emulator_node:main",
            "ray_edge_emulator = vtff_sim_bridge.ray_edge_emulator_node:main",
            "simgen_bridge = vtff_sim_bridge.simgen_bridge_node:main",
            "simgen_emulator = vtff_sim_bridge.simgen.simgen_emulator:main",
        ],
    },
)
