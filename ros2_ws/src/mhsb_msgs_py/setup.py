from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "mhsb_msgs_py"

setup(
    name=PACKAGE,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Names, QoS profiles, status codes and message codecs of the MHSB suite.",
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
)
