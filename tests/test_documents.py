"""The documents: they build without a warning, and what they name is there."""

import dataclasses
import importlib
import importlib.machinery
import importlib.util
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from mhsb_model import command_line
from mhsb_model.linkages.linkage import build_linkage_row, cylinder_length
from mhsb_model.schema import FourBar
from mhsb_model.trajectory import MotionState
from mhsb_planner.errors import NoPathError
from mhsb_planner.online.goal_planning import START_UP
from mhsb_planner.online.hand_over import LONGEST_WAIT
from mhsb_planner.online.rest_detector import OLDEST_STATE
from mhsb_planner.online.start_state import NoStateError
from mhsb_planner.planner import PlanOptions
from mhsb_planner.planners.registry import REGISTERED_PLANNERS
from mhsb_tools.executables import SUBCOMMAND_TABLE

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
LINKAGES = DOCS / "linkages.md"
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
    run = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=240)
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


@pytest.mark.parametrize(
    "page", ["options.md", "parameters.md", "machine_file.md", "goal_states.md", "interfaces.md"]
)
def test_a_page_that_follows_from_the_code_is_what_the_code_says(page, ros_domain):
    written = script(DOCS / "reference.py").PAGES[page]()
    told = f"the page {page} is not what the code says; run: python docs/reference.py"
    assert (DOCS / page).read_text() == written, told


def test_the_four_bar_search_of_the_page_finds_a_nearly_constant_moment_arm(capsys):
    [words] = re.findall(r"python docs/four_bar_search\.py ([-\d ]+\d)", LINKAGES.read_text())
    search = script(DOCS / "four_bar_search.py").search
    assert command_line.run(search, words.split()) == 0
    lower, upper, wanted, direction = map(float, words.split())
    found = FourBar.model_validate(yaml.safe_load(capsys.readouterr().out))
    angles = np.radians(np.linspace(lower, upper, 200))
    row = build_linkage_row(found)
    lengths = np.array([cylinder_length(row, angle) for angle in angles])
    np.testing.assert_allclose(np.gradient(lengths, angles), 1e-3 * wanted, rtol=0.1)
    assert math.degrees(found.parent_pin.angle) == pytest.approx(direction)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("-110 40 -45", "four_bar_search: missing DIRECTION"),
        ("40 -110 -45 165", "LOWER 40° must be below UPPER -110°"),
        ("-110 40 0 165", "ARM must not be 0 mm"),
        ("-110 40 -45 back", "DIRECTION takes"),
    ],
)
def test_the_four_bar_search_refuses_bad_numbers_in_one_sentence(capsys, words, sentence):
    search = script(DOCS / "four_bar_search.py").search
    assert command_line.run(search, words.split(), name="four_bar_search") == 2
    [line] = capsys.readouterr().err.splitlines()
    assert sentence in line


@pytest.fixture(scope="module")
def own_planner():
    """The example's names, and a function that plans with its planner."""
    shown: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(REGISTERED_PLANNERS, "straight", None)  # the example registers its own
        exec((ROOT / "examples" / "04_own_planner.py").read_text(), shown)
        yield shown


def plan_straight(shown, start, **options):
    options = PlanOptions(planner="straight", **options)
    return shown["planner"].plan((0.55, 0.3), start, options=options)


def test_the_planner_that_a_page_links_plans_and_stays_at_a_goal(own_planner):
    plan, machine = plan_straight(own_planner, own_planner["start"]), own_planner["machine"]
    end = plan.motion.trajectory.position[-1]
    np.testing.assert_allclose(machine.tip_position(end), (0.55, 0.3), atol=1e-6)
    assert plan.lower_bound <= plan.energy.paper
    psi = machine.end_link_angle(end)
    end = MotionState.at_rest(end)
    assert plan_straight(own_planner, end).path.steps == 0
    assert plan_straight(own_planner, end, goal_psi=psi).path.steps == 0
    assert plan_straight(own_planner, end, goal_psi=psi + 0.05).path.steps > 0


def test_that_planner_tries_further_goal_postures_and_names_what_it_did_not_find(
    own_planner, monkeypatch
):
    price, tried = own_planner["price_path"], []

    def price_all_but_the_first(*path):
        tried.append(path)
        return price(*path) if len(tried) > 1 else None

    monkeypatch.setitem(own_planner, "price_path", price_all_but_the_first)
    plan_straight(own_planner, own_planner["start"])
    assert len(tried) == 3
    monkeypatch.setitem(own_planner, "price_path", lambda *path: None)
    with pytest.raises(NoPathError):
        plan_straight(own_planner, own_planner["start"])


def test_a_planner_passes_the_test_that_its_page_shows(own_planner):
    page = (DOCS / "planners.md").read_text()
    shown: dict = {}
    exec(page.partition('title="test_straight.py"\n')[2].partition("```")[0], shown)
    [test] = (function for name, function in shown.items() if name.startswith("test_"))
    test(own_planner["machine"], own_planner["planner"].graph.table)


def test_the_lines_of_the_readme_plan_when_they_are_pasted(tmp_path, monkeypatch):
    page = (ROOT / "README.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    [goal] = set(re.findall(r"\.plan\(\(([^)]+)\)", "".join(blocks)))
    monkeypatch.chdir(tmp_path)  # the lines may write files
    pasted: dict = {}
    for lines in blocks:
        exec(lines, pasted)
    plan = pasted["plan"]
    end = plan.machine.tip_position(plan.motion.trajectory.position[-1])
    np.testing.assert_allclose(end, [float(value) for value in goal.split(",")], atol=1e-6)


def test_every_command_has_its_line():
    page = (DOCS / "commands.md").read_text()
    for setup in ROOT.glob("ros2_ws/src/*/setup.py"):
        package = setup.parent.name
        for name in re.findall(r'"(\w+) = ', setup.read_text()):
            entry = getattr(importlib.import_module(f"{package}.executables"), name)
            if not re.match("forward_to_tools|_former", entry.__qualname__):
                assert name == "mhsb" or f"`ros2 run {package} {name}" in page
    for name in SUBCOMMAND_TABLE:
        assert f"| `mhsb {name}" in page


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
    assert {*re.findall(r"^mhsb ([\w-]+)", "\n".join(wanted), re.MULTILINE)} <= set(
        SUBCOMMAND_TABLE
    )
    for path in re.findall(r"scripts/\w+", "\n".join(wanted)):
        assert (ROOT / path).exists() or (ROOT / f"{path}.sh").exists()
    logged = re.findall(r"^\| `(.+?)`", (DOCS / "tutorial_log.md").read_text(), re.MULTILINE)
    assert {each.replace("\\|", "|") for each in logged} == {c.splitlines()[0] for c in wanted}


UNITS = {"": 1, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30}
BOUND = re.compile(r"^\|[^|]+\| ([\d,.]+) ?(\w*) \| `([\w.]+):(\w+)` \|$", re.MULTILINE)


def test_bounds_in_the_page_on_security_are_those_of_the_code():
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    bounds = BOUND.findall(page)
    rows = page.partition("| bound | value | constant |")[2].partition("\n\n")[0].splitlines()[2:]
    assert len(bounds) == len(rows) > 10
    for value, unit, module, name in bounds:
        stated = float(value.replace(",", "")) * UNITS[unit]
        assert stated == getattr(importlib.import_module(module), name), (module, name)


def test_troubleshooting_has_the_times_after_which_the_state_of_the_arm_is_missed():
    page = (DOCS / "troubleshooting.md").read_text()
    assert (
        f"is older than {OLDEST_STATE:g} s, and none came while the goal waited: for "
        f"{LONGEST_WAIT:g} s, and until {START_UP:g} s after the planner's start"
    ) in page
    assert f"in the last {OLDEST_STATE:g} s" in str(NoStateError())
