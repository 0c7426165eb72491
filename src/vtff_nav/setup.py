"""Build description of vtff_nav."""

from setuptools import find_packages, setup

package_name = "vtff_nav"

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
        "filterpy>=1.4.5,<3",
        "pyserial>=3.5,<4",
        "vtff_dynamics==0.1.0",
        "vtff_gnss==0.1.0",
    ],
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="Receiver driver and relative navigation.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "attitude_estimator = vtff_nav.attitude_estimator_node:main",
            "receiver_driver = vtff_nav.receiver_driver_node:main",
            "reference_orbit = vtff_nav.reference_orbit_node:main",
            "relative_ekf = vtff_nav.relative_ekf_node:main",
        ],
        "vtff.estimators": [
            "cdgps = vtff_nav.relative.shipped_estimators:make_cdgps",
            "paper = vtff_nav.relative.shipped_paper:make_paper",
        ],
    },
)
