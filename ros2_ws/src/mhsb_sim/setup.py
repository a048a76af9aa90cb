from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "mhsb_sim"


def share_folder(folder: str) -> list[tuple[str, list[str]]]:
    """List all files below a folder, to be installed at the same place below the share folder.

    Args:
        folder: Folder of the package.

    Returns:
        Pairs of target folder and list of files, as `data_files` of setuptools.
    """
    files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return [(f"share/{PACKAGE}/{path.parent}", [str(path)]) for path in files]


setup(
    name=PACKAGE,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Simulator of the hydraulic manipulator",
    license="Apache-2.0",
    maintainer="MHSB maintainers",
    maintainer_email="mhsb@example.org",
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["py.typed"]},
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
            "sim_node = mhsb_sim.executables:sim_node",
            "simulate = mhsb_sim.executables:simulate",
            "compare = mhsb_sim.executables:compare",
            "study = mhsb_sim.executables:study",
            "tune = mhsb_sim.executables:tune",
            "record = mhsb_sim.executables:record",
            "report = mhsb_sim.executables:report",
            "animate = mhsb_sim.executables:animate",
            "demo = mhsb_sim.executables:demo",
            "viewer = mhsb_sim.executables:viewer",
        ],
    },
)
