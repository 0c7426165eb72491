"""Build description of vtff_gnss."""

from setuptools import find_packages, setup

package_name = "vtff_gnss"

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
        "novatel_edie>=2.10.11,<2.11",
        "hatanaka>=2.8,<3",
        "vtff_dynamics==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="GNSS signals, ephemerides and receiver log codec (library, no ROS).",
    license="Apache-2.0",
)
