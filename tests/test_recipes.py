"""The recipes of docs/extending.md: each adds its component to a copy of the packages."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
RECIPE_PAGE = (ROOT / "docs" / "extending.md").read_text()
SECTIONS = RECIPE_PAGE.split("\n## ")
BLOCK = re.compile(r'^```(python|diff) title="(\S+)"\n(.*?)^```', re.MULTILINE | re.DOTALL)
RECIPES = {section.partition("\n")[0]: BLOCK.findall(section) for section in SECTIONS}


EXCERPT = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_excerpts_are_lines_of_a_shipped_valve():
    [excerpt] = EXCERPT.findall(RECIPE_PAGE)
    shipped = ROOT / "ros2_ws/src/mhsb_sim/mhsb_sim/circuit/valves/counterbalance.py"
    assert excerpt in shipped.read_text()


def add_lines(text: str, changes: str) -> str:
    """Insert each line that begins with + below the lines above it, which the text has once."""
    above = ""
    for change in changes.splitlines(keepends=True):
        line = change[1:]
        if change.startswith("+"):
            assert text.count(above) == 1, above
            text = text.replace(above, above + line)
            above += line
        else:
            above = "\n" + line
    return text


@pytest.mark.parametrize("recipe", [name for name, blocks in RECIPES.items() if blocks])
def test_a_recipe_s_module_and_lines_pass_its_test(tmp_path, recipe):
    """Kernels run as plain Python, which is quicker than to compile a copy of all packages."""
    for package in ("mhsb_model", "mhsb_control", "mhsb_planner", "mhsb_sim"):
        inner = Path(package) / package
        shutil.copytree(ROOT / "ros2_ws/src" / inner, tmp_path / inner)
    records = tmp_path / "mhsb_model/mhsb_model/records.py"
    lines = records.read_text().replace(
        "record_dtype(kind))", "record_dtype(kind)).view(np.recarray)"
    )
    assert lines.count("np.recarray") == 1  # whose fields are attributes without numba, too
    records.write_text(lines)
    for kind, name, content in RECIPES[recipe]:
        file = tmp_path / name
        if kind == "diff":
            file.write_text(add_lines(file.read_text(), content))
        else:
            assert not file.exists()
            file.write_text(content)
    paths = [str(folder) for folder in tmp_path.iterdir() if folder.is_dir()]
    paths.append(os.environ.get("PYTHONPATH", ""))
    environment = {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_DISABLE_JIT": "1"}
    [test] = tmp_path.glob("test_*.py")
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(test)],
        env=os.environ | environment, cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
