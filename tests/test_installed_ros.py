"""The set-up beside an installed ROS 2 Jazzy, for which the wheels' own files stand at a prefix."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import Distribution, distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FROM_DEBIAN = ("PyYAML", "lark-parser", "packaging", "typing_extensions")
"""What an installed rclpy finds beside it, as packages of the system's Python."""

CLEAN = {
    "HOME": os.environ["HOME"],
    "PATH": os.defpath,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    **{name: value for name, value in os.environ.items() if name.endswith("_CACHE_HOME")},
}

LONG = 600.0  # s, for pip, colcon and the kernels


def belongs_to_ros(distribution: Distribution) -> bool:
    name = distribution.metadata["Name"]
    return name.startswith("ros-") or name in FROM_DEBIAN


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A prefix with a setup.bash, as of /opt/ros/jazzy, and a folder with its python3."""
    prefix = tmp_path_factory.mktemp("ros") / "jazzy"
    site = prefix / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
    for distribution in filter(belongs_to_ros, distributions()):
        for file in distribution.files or ():
            source, target = Path(str(file.locate())), Path(os.path.normpath(site / file))
            if source.is_file() and target.is_relative_to(prefix) and source.suffix != ".pth":
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
    libraries = [prefix / "lib", *site.glob("*.libs")]
    exported = {
        "ROS_DISTRO": "jazzy",
        "ROS_VERSION": "2",
        "AMENT_PREFIX_PATH": prefix,
        "PYTHONPATH": site,
        "LD_LIBRARY_PATH": ":".join(map(str, libraries)),
    }
    lines = [f"export {name}='{value}'\n" for name, value in exported.items()]
    (prefix / "setup.bash").write_text("".join(lines), encoding="utf-8")
    (prefix / "bin").mkdir(exist_ok=True)
    base = Path(sys.base_prefix) / "bin" / f"python{sys.version_info[0]}.{sys.version_info[1]}"
    (prefix / "bin" / "python3").symlink_to(base)
    return prefix


def shell(prefix: Path, venv: Path, commands: str) -> subprocess.CompletedProcess:
    """Commands in a shell that has sourced the installed ROS."""
    environment = {**CLEAN, "MHSB_VENV": str(venv)}
    environment["PATH"] = f"{prefix / 'bin'}:{environment['PATH']}"
    script = f"set -euo pipefail; source '{prefix}/setup.bash'; cd '{ROOT}'; {commands}"
    return subprocess.run(
        ["bash", "-c", script], env=environment, capture_output=True, text=True, timeout=LONG
    )


@pytest.mark.slow
@pytest.mark.timeout(2 * LONG)
def test_an_installed_ros_is_used_with_the_numpy_it_was_made_for(installed, tmp_path, ros_domain):
    venv = tmp_path / "venv"
    made = shell(installed, venv, "scripts/setup")
    assert made.returncode == 0, made.stderr
    assert made.stdout.splitlines() == [str(venv), str(venv / "ros2_ws"), "system"]
    assert made.stderr.count("installing packages") == 1
    assert "include-system-site-packages = true" in (venv / "pyvenv.cfg").read_text()

    again = shell(installed, venv, "scripts/setup")
    assert (again.returncode, again.stderr) == (0, "")
    assert again.stdout == made.stdout

    where = "import numpy, rclpy; print(numpy.__version__, rclpy.__file__)"
    asked = shell(installed, venv, f'source scripts/env.sh; python -c "{where}"')
    assert asked.returncode == 0, asked.stderr
    numpy, rclpy = asked.stdout.split()
    assert numpy.startswith("1.26.")
    assert Path(rclpy).is_relative_to(installed)
    assert list(venv.rglob("rclpy")) == []

    planned = shell(installed, venv, "source scripts/env.sh; mhsb plan --case 1-1")
    assert planned.returncode == 0, planned.stderr
    assert "trajectory:" in planned.stdout

    (tmp_path / "goals.yaml").write_text("- {x: 0.55, z: 0.60}\n", encoding="utf-8")
    demo = f"mhsb demo --goals {tmp_path}/goals.yaml --output {tmp_path}/demo"
    domain = f"export ROS_DOMAIN_ID={ros_domain}"
    shown = shell(installed, venv, f"source scripts/env.sh; {domain}; {demo}")
    assert shown.returncode == 0, shown.stderr
    summary = json.loads((tmp_path / "demo" / "summary.json").read_text(encoding="utf-8"))
    assert summary["goals_reached"] == 1


def test_another_ros_than_jazzy_is_refused_by_its_name(tmp_path):
    environment = {**CLEAN, "ROS_DISTRO": "humble", "MHSB_VENV": str(tmp_path / "venv")}
    refused = subprocess.run(
        [ROOT / "scripts/setup"], env=environment, capture_output=True, text=True, timeout=LONG
    )
    assert refused.returncode == 1
    assert refused.stderr == (
        "MHSB set-up: ROS 2 humble is sourced in this shell, but MHSB needs Jazzy; "
        "use a shell without it.\n"
    )
