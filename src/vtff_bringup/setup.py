"""Build description of vtff_bringup."""

from glob import glob

from setuptools import find_packages, setup

package_name = "vtff_bringup"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
        ("share/" + package_name + "/launch", glob("launch/*.launch.py")),
        *(
            # "config" links to the workspace's folder of that name.
            ("share/" + package_name + "/" + folder, glob(folder + "/*.*"))
            for folder in (
                "config/system",
                "config/scenario",
                "config/campaign",
                "config/params",
                "config/dds",
                "config/can",
                "config/gnss",
                "config/ionosphere",
                "config/formation",
            )
        ),
    ],
    package_data={package_name: ["py.typed"]},
    install_requires=[
        "numpy>=1.26,<3",
        "scipy>=1.11,<2",
        "pyarrow>=17,<30",
        "rich>=13,<16",
        "typer>=0.19,<1",
        "dask>=2024.8,<2027",
        "distributed>=2024.8,<2027",
        "psutil>=5.9,<8",
        "vtff_analysis==0.1.0",
        "vtff_bag==0.1.0",
        "vtff_control==0.1.0",
        "vtff_dynamics==0.1.0",
        "vtff_gnss==0.1.0",
        "vtff_iono==0.1.0",
        "vtff_nav==0.1.0",
        "vtff_node==0.1.0",
        "vtff_sim_bridge==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="System files, runner, launch files and the vtff command.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "vtff = vtff_bringup.cli:main",
        ],
    },
)
