"""What a package imports is what its package.xml declares, by rosdep's keys."""

import ast
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(file.parent for file in ROOT.glob("ros2_ws/src/*/setup.py"))
KEYS = {
    "PIL": "python3-pil",
    "hypothesis": "python3-hypothesis",
    "matplotlib": "python3-matplotlib",
    "mpl_toolkits": "python3-matplotlib",
    "mujoco": "python3-mujoco-pip",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pydantic": "python3-pydantic",
    "pytest": "python3-pytest",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "tqdm": "python3-tqdm",
    "websockets": "python3-websockets",
    "yaml": "python3-yaml",
}
"""rosdep's keys of modules; packages of ROS are their own."""

WITHOUT_KEY = {"distributed", "llvmlite", "lz4", "mcap", "tyro", "viser", "zstandard"}
"""Modules that rosdep does not know: the README names them."""


def imported(folders) -> set[str]:
    """Top-level modules that the Python files of folders import, Python's own left out."""
    names = set()
    for file in (file for folder in folders for file in folder.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module.split(".")[0])
    return names - set(sys.stdlib_module_names)


def keys(package, folders) -> set[str]:
    names = imported(package / folder for folder in folders) - WITHOUT_KEY - {package.name}
    return {KEYS.get(name, name) for name in names}


def declared(package, kind) -> set[str]:
    root = ElementTree.parse(package / "package.xml").getroot()
    return {element.text for element in root.findall(kind)}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_a_package_declares_what_it_imports_and_nothing_else(package):
    needed = keys(package, [package.name, "launch"])
    assert declared(package, "exec_depend") == needed
    assert declared(package, "test_depend") == keys(package, ["test"]) - needed


def test_the_readme_names_what_rosdep_does_not_know():
    [line] = re.findall(r"pip install (.+?) +#", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert set(line.split()) == WITHOUT_KEY
    everything = set().union(*(imported([package / package.name]) for package in PACKAGES))
    assert everything >= WITHOUT_KEY
