"""Build description of vtff_dynamics."""

from setuptools import find_packages, setup

package_name = "vtff_dynamics"

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
        "brahe>=1.8,<1.9",
        "numba>=0.60,<1",
        "scipy>=1.11,<2",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="Time scales, frames, orbit propagation and relative motion (library, no ROS).",
    license="Apache-2.0",
)
