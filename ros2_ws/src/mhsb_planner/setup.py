from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "mhsb_planner"

setup(
    name=PACKAGE,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Online motion planner for hydraulic manipulators",
    license="Apache-2.0",
    maintainer="MHSB maintainers",
    maintainer_email="mhsb@example.org",
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"], "cluster": ["distributed>=2024.1"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "planner_node = mhsb_planner.executables:planner_node",
            "build_table = mhsb_planner.executables:build_table",
            "plan = mhsb_planner.executables:plan",
            "goal = mhsb_planner.executables:goal",
            "reproduce = mhsb_planner.executables:reproduce",
        ],
    },
)
