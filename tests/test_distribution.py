"""The distribution `mhsb`: its wheel in an empty folder, and what stands in several files."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from importlib.metadata import distributions, packages_distributions
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from tests.test_packages import PACKAGES, imported

import mhsb_model

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PUBLIC = """
import sys
from mhsb_control import load_machine, make_controller
from mhsb_model import MhsbError, MotionState, Trajectory, find_config_file, load_machine
from mhsb_planner import Deadline, Plan, Planner, PlanOptions, load_or_build_table
from mhsb_sim import Simulator
from mhsb_tools import draw_move_page, move_of_plan
print(find_config_file("demo_goals.yaml"))
print(sorted({"rclpy", "numba", "matplotlib", "viser"} & set(sys.modules)))
"""
NEED_ROS = ["demo", "goal", "record", "report", "view", "param", "call", "echo"]


def normalized(name: str) -> str:
    return re.sub("[-_.]+", "-", name).lower()


def declared(*requirements: str) -> dict[str, Requirement]:
    """Requirements by normalized names; those on the distribution itself are left out."""
    parsed = [Requirement(each) for each in requirements]
    return {
        re.sub("[-_.]+", "-", each.name).lower(): each for each in parsed if each.name != "mhsb"
    }


EXTRAS = [each for extra in PROJECT["optional-dependencies"].values() for each in extra]
DECLARED = declared(*PROJECT["dependencies"], *EXTRAS)


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """Folder `bin` of an environment with the wheel and all else that is here, except ROS."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE", "config", "ros2_ws/src"):
        source, target = ROOT / name, folder / "source" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(source, target, symlinks=True) if source.is_dir() else shutil.copy(
            source, target
        )
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    wheel = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder]
    subprocess.run([*wheel, folder / "source"], check=True)
    [built] = folder.glob("*.whl")
    assert built.name == f"mhsb-{mhsb_model.__version__}-py3-none-any.whl"
    venv = folder / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    python = venv / "bin" / "python"
    install = [*pip, "--python", python, "install", "--no-deps", "--no-compile"]
    subprocess.run([*install, built], check=True)
    others = folder / "others"
    others.mkdir()
    ros = {
        Path(file).parts[0]
        for distribution in distributions()
        if distribution.metadata["Name"].startswith("ros-")
        for file in distribution.files or ()
    }
    for path in Path(sysconfig.get_path("purelib")).iterdir():
        if path.name not in ros and "mhsb" not in path.name and path.suffix != ".pth":
            (others / path.name).symlink_to(path)
    [site] = venv.glob("lib/python*/site-packages")
    (site / "others.pth").write_text(f"{others}\n", encoding="utf-8")
    return python.parent


@pytest.fixture
def run(installed, tmp_path):
    """Function (words...) that runs a program of the environment in an empty folder."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH", "VIRTUAL_ENV")
    }

    def start(*words: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            [installed / words[0], *words[1:]],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )

    return start


def test_the_wheel_checks_a_machine_in_an_empty_folder(run):
    assert run("mhsb", "--version").stdout == f"mhsb {mhsb_model.__version__}\n"
    checked = run("mhsb", "check", "mhsb_arm3")
    assert checked.returncode == 0, checked.stderr
    assert checked.stdout.startswith("mhsb_arm3: 3 joints")


def test_public_names_of_the_wheel_are_imported_without_ros_and_numba(run, installed):
    done = run("python", "-c", PUBLIC)
    assert done.returncode == 0, done.stderr
    found, loaded = done.stdout.splitlines()
    assert found.startswith(str(installed.parent / "lib"))
    assert found.endswith("mhsb_model/config/demo_goals.yaml")
    assert loaded == "[]"


@pytest.mark.parametrize("name", NEED_ROS)
def test_what_needs_ros_says_in_one_sentence_how_to_get_it(run, name):
    done = run("mhsb", name, "--help")
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith(f"mhsb {name}: this needs ROS 2 Jazzy: install it by pip install")


def test_the_nodes_say_in_one_sentence_how_to_get_ros(run):
    for node in ("planner_node", "sim_node"):
        done = run("python", "-m", f"mhsb_{node.removesuffix('_node')}.executables", node)
        assert done.returncode == 1
        assert done.stderr.startswith(f"{node}: this needs ROS 2 Jazzy: ")
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_each_package_is_there_once(package):
    """colcon's links and pip's editable installation lead to the same folder."""
    sources = {package / package.name}
    found = {
        (Path(entry) / package.name).resolve()
        for entry in sys.path
        if (Path(entry) / package.name / "__init__.py").exists()
    }
    assert found == sources
    asked = f"import {package.name}; print({package.name}.__path__[0])"
    alone = subprocess.run(
        [sys.executable, "-I", "-c", asked], capture_output=True, text=True, check=True
    )
    assert {Path(alone.stdout.strip()).resolve()} == sources


def test_all_packages_have_one_version():
    """ROS wants it in each package.xml; everything else reads it."""
    version = mhsb_model.__version__
    for file in ROOT.glob("ros2_ws/src/*/package.xml"):
        assert ElementTree.parse(file).findtext("version") == version, file
    for file in ROOT.glob("ros2_ws/src/*/setup.py"):
        assert 'version=ElementTree.parse("package.xml")' in file.read_text(encoding="utf-8"), file
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_distribution_declares_what_the_packages_import():
    brought_by = packages_distributions()
    names = set().union(*(imported([package / package.name]) for package in PACKAGES))
    third_party = {name for name in names if not name.startswith("mhsb_")}
    wanted = {
        normalized(brought_by[name][0])
        for name in third_party
        if not any(each.startswith("ros-") for each in brought_by.get(name, ["ros-"]))
    }
    assert wanted - {"matplotlib"} <= set(DECLARED)
    assert {"numpy", "scipy", "numba", "pydantic", "mujoco-core", "matplotlib"} <= set(DECLARED)


def test_the_versions_that_setup_installs_are_among_those_that_the_distribution_allows():
    lines = "\n".join((ROOT / f"requirements{kind}.txt").read_text() for kind in ("", "-ros"))
    pinned = declared(*re.findall(r"^[^#\s][^#\n]*", lines, re.MULTILINE))
    for name, requirement in DECLARED.items():
        for each in pinned[name].specifier:
            if each.operator == "==":
                assert requirement.specifier.contains(each.version), name
