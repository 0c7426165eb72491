"""Build description of vtff_bag."""

from setuptools import find_packages, setup

package_name = "vtff_bag"

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
        "mcap>=1.5,<2",
        "zstandard>=0.21,<1",
        "lz4>=4.3,<5",
        "vtff_dynamics==0.1.0",
        "vtff_node==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="MCAP bags: files, recorder, player and run folder.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bag_player = vtff_bag.bag_player_node:main",
            "bag_recorder = vtff_bag.bag_recorder_node:main",
        ],
    },
)
