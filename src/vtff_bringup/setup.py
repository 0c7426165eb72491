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
            )
        ),
    ],
    package_data={package_name: ["py.typed"]},
    install_requires=["setuptools"],
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
