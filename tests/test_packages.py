"""What a package imports is declared in its package.xml, and what other files import exists."""

import ast
import importlib
import importlib.util
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

WITHOUT_KEY = {
    *("distributed", "docstring_parser", "llvmlite", "lz4", "mcap", "tyro", "viser", "zstandard")
}
"""Modules that rosdep does not know: the page on installation names them."""

NOT_INSTALLED = {"benchmarks", "tests"}
"""Packages in the repository's root, which is on the path of tests."""


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
    return {KEYS.get(name, name) for name in names - NOT_INSTALLED}


def declared(package, kind) -> set[str]:
    root = ElementTree.parse(package / "package.xml").getroot()
    return {element.text for element in root.findall(kind)}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_a_package_declares_what_it_imports_and_nothing_else(package):
    assert not imported([package / package.name, package / "launch"]) & NOT_INSTALLED
    needed = keys(package, [package.name, "launch"])
    assert declared(package, "exec_depend") == needed
    assert declared(package, "test_depend") == keys(package, ["test"]) - needed


def test_the_page_on_installation_names_what_rosdep_does_not_know():
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    [line] = re.findall(r"pip install (.+?) +#", page)
    assert set(line.split()) == WITHOUT_KEY
    everything = set().union(*(imported([package / package.name]) for package in PACKAGES))
    assert everything >= WITHOUT_KEY


IMPORT = re.compile(r"^ *from (mhsb_[\w.]+) import (\([^)]*\)|[\w, ]+)", re.MULTILINE)
OUTSIDE = [*ROOT.glob("ros2_ws/src/*/launch/*.py"), *ROOT.glob("docs/*.md"), ROOT / "README.md"]
"""Files that neither mypy nor a test reads: launch files need an installed ROS."""


def exists(module: str, name: str) -> bool:
    found = importlib.import_module(module)
    if hasattr(found, name):
        return True
    is_package = hasattr(found, "__path__")
    return is_package and importlib.util.find_spec(f"{module}.{name}") is not None


TITLE = re.compile(r'title="\w+/(mhsb_[\w/]+)\.py"')
"""Title of a code block that is a new file: package, then the module's path."""


def test_what_launch_files_and_pages_import_of_the_suite_exists():
    texts = {file: file.read_text(encoding="utf-8") for file in OUTSIDE}
    found = [
        (file.name, module, name)
        for file, text in texts.items()
        for module, names in IMPORT.findall(text)
        for name in re.findall(r"\w+", names)
    ]
    assert len({file for file, _, _ in found}) > 3
    made = {path.replace("/", ".") for text in texts.values() for path in TITLE.findall(text)}
    known = [each for each in found if each[1] not in made]  # test_recipes.py makes the others
    assert [each for each in known if not exists(*each[1:])] == []
    assert not exists("mhsb_model.machine", "no_such_name")
