from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "mhsb_tools"


def share_folder(folder: str) -> list[tuple[str, list[str]]]:
    """Every file below `folder`, for the same place below the package's share folder."""
    files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return [(f"share/{PACKAGE}/{path.parent}", [str(path)]) for path in files]


setup(
    name=PACKAGE,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Commands beside the nodes",
    license="Apache-2.0",
    maintainer="MHSB maintainers",
    maintainer_email="mhsb@example.org",
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["py.typed", "completion.bash"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *share_folder("launch"),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"], "viewer": ["viser>=1.1"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "mhsb = mhsb_tools.executables:mhsb",
            "check = mhsb_tools.executables:check",
            "plan = mhsb_tools.executables:plan",
            "reproduce = mhsb_tools.executables:reproduce",
            "simulate = mhsb_tools.executables:simulate",
            "compare = mhsb_tools.executables:compare",
            "study = mhsb_tools.executables:study",
            "tune = mhsb_tools.executables:tune",
            "record = mhsb_tools.executables:record",
            "report = mhsb_tools.executables:report",
            "animate = mhsb_tools.executables:animate",
            "demo = mhsb_tools.executables:demo",
            "viewer = mhsb_tools.executables:viewer",
        ],
    },
)
