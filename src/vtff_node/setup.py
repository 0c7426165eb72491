"""Build description of vtff_node."""

from setuptools import find_packages, setup

package_name = "vtff_node"

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
        "ruamel.yaml>=0.17.21,<0.20",
        "python-can[multicast]>=4.6,<5",
        "vtff_dynamics==0.1.0",
        "vtff_gnss==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="What every vtff node shares: parameters, QoS, diagnostics, lockstep, main loop.",
    license="Apache-2.0",
)
