from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "mhsb_model"


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
    description="Machine model of a hydraulic manipulator with booster modules",
    license="Apache-2.0",
    maintainer="MHSB maintainers",
    maintainer_email="mhsb@example.org",
    packages=find_packages(exclude=["test"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *share_folder("config"),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "check = mhsb_model.executables:check",
        ],
    },
)
