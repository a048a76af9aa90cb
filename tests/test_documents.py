"""The documents: they build without a warning, and what they name is there."""

import dataclasses
import importlib
import importlib.machinery
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
REMOTE = ("http://", "https://", "mailto:")


def script(path: Path):
    """A Python script as a module, whatever it is called."""
    loader = importlib.machinery.SourceFileLoader(path.stem, str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(path.stem, loader))
    loader.exec_module(module)
    return module


def test_they_build_without_a_warning(tmp_path):
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"]
    run = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "site" / "index.html").exists()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_what_is_in_the_repository(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not target.startswith((*REMOTE, "#")):
            assert (page.parent / target.partition("#")[0]).exists(), target


def exists(name: str) -> bool:
    """Whether `module.Class.field` is there, fields without a default included."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        module = ".".join(parts[:length])
        try:
            found = importlib.import_module(module)
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            fields = getattr(found, "model_fields", {}) or getattr(found, "__annotations__", {})
            if dataclasses.is_dataclass(found):
                fields = {field.name for field in dataclasses.fields(found)}
            if part not in fields and not hasattr(found, part):
                return False
            found = getattr(found, part, None)
        return True
    return False


def test_every_name_in_the_table_of_symbols_exists():
    table = (DOCS / "method.md").read_text().partition("## Symbols")[2].partition("\n## ")[0]
    names = re.findall(r"`(mhsb_[\w.]+)`", table)
    assert len(names) > 30
    assert [name for name in names if not exists(name)] == []
    assert not exists("mhsb_model.arrays.MachineArrays.no_such_field")


def test_modules_that_pages_name_exist():
    for page in DOCS.glob("*.md"):
        for name in re.findall(r"`(mhsb_\w+(?:\.\w+)+)`", page.read_text()):
            assert exists(name) or name.endswith(".yaml"), f"{page.name}: {name}"


@pytest.mark.parametrize("page", ["parameters.md", "machine_file.md"])
def test_a_page_that_follows_from_the_code_is_what_the_code_says(page, ros_domain):
    written = script(DOCS / "reference.py").PAGES[page]()
    told = f"the page {page} is not what the code says; run: python docs/reference.py"
    assert (DOCS / page).read_text() == written, told


def test_every_command_has_its_line():
    page = (DOCS / "commands.md").read_text()
    for setup in ROOT.glob("ros2_ws/src/*/setup.py"):
        for name in re.findall(r'"(\w+) = ', setup.read_text()):
            assert f"`{setup.parent.name} {name}" in page


def test_the_tutorial_runs_its_own_commands_in_order(tmp_path, capfd):
    tutorial = script(ROOT / "scripts" / "tutorial")
    blocks = ("x=1\n(exit 0) && y='it''s' &", "cat <<E\n$x\nE", "false\necho never")
    page = "\n```text\nno\n```\n".join(f"```bash\n{block}\n```" for block in blocks)
    wanted = tutorial.commands(page)
    assert wanted == ["x=1", "(exit 0) && y='it''s' &", "cat <<E\n$x\nE", "false", "echo never"]
    (tmp_path / "mhsb").mkdir()
    code, took = tutorial.run(tmp_path, wanted)
    assert code == 1
    assert [status for status, _ in took] == [0, 0, 0, 1]
    assert capfd.readouterr().out == "1\n"
    assert "| `false` |" in tutorial.log(wanted, took, "abc")


def test_the_tutorials_commands_are_there():
    tutorial = script(ROOT / "scripts" / "tutorial")
    page = (DOCS / "tutorial.md").read_text()
    wanted = tutorial.commands(page)
    started = re.findall(r"ros2 run (\w+) (\w+)", "\n".join(wanted))
    installed = "".join(file.read_text() for file in ROOT.glob("ros2_ws/src/*/setup.py"))
    for package, name in started:
        assert f'"{name} = {package}.' in installed
    for path in re.findall(r"scripts/\w+", "\n".join(wanted)):
        assert (ROOT / path).exists() or (ROOT / f"{path}.sh").exists()
    logged = re.findall(r"^\| `(.+?)`", (DOCS / "tutorial_log.md").read_text(), re.MULTILINE)
    assert {each.replace("\\|", "|") for each in logged} == {c.splitlines()[0] for c in wanted}
