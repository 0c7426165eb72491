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
    package_data={package_name: ["py.typed", "report/report.css", "studies/*.j2", "view/web/**"]},
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="vtff developers",
    maintainer_email="maintainers@vtff.example",
    description="Reports, comparisons, exports, views, TEC, baselines and studies of recordings.",
    license="Apache-2.0",
)
