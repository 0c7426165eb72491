"""Build description of vtff_analysis."""

from setuptools import find_packages, setup

package_name = "vtff_analysis"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    package_data={
        package_name: [
            "py.typed",
            "page/*.css",
            "page/*.j2",
            "page/*.js",
            "studies/*.j2",
            "view/web/**",
        ]
    },
    install_requires=[
        "numpy>=1.26,<3",
        "brahe>=1.8,<1.9",
        "scipy>=1.11,<2",
        "matplotlib>=3.8,<4",
        "pillow>=10,<14",
        "pyarrow>=17,<30",
        "rich>=13,<16",
        "Jinja2>=3.1,<4",
        "foxglove-sdk>=0.14,<1",
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
    description="Reports, comparisons, exports, views, TEC, baselines and studies of recordings.",
    license="Apache-2.0",
)
