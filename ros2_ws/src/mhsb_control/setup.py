from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "mhsb_control"

setup(
    name=PACKAGE,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Servo controllers of a hydraulic manipulator",
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
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [],
    },
)
