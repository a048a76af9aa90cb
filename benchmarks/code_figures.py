"""Count what makes the installed packages hard to read: size, long functions, missing docstrings.

    python benchmarks/code_figures.py
    python benchmarks/code_figures.py --json
    python benchmarks/code_figures.py --worst 20

Everything is read from the syntax trees of `ros2_ws/src`, tests left out. The figures:

- statements: `ast.stmt` nodes without docstrings
- complexity: 1 + the branches of a function (McCabe), including nested functions
- parameters: of all kinds, without `self` and `cls`
- undocumented: functions of six lines and more without a docstring
- class names defined twice: public classes that are defined in more than one module
- tuned numbers: fields of settings classes whose docstring gives an origin, and how many of them
  give what a change by 30 % does
"""

from __future__ import annotations

import ast
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

SOURCES = Path(__file__).resolve().parent.parent / "ros2_ws" / "src"
LONG_BODY = 6
"""Number of body lines from which on a function needs a docstring."""

MANY_PARAMETERS = 8
"""Number of parameters from which on a function is counted as having many."""
BRANCHES = (
    ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension, ast.match_case,
    ast.Assert,
)  # fmt: skip

FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class FunctionFigures:
    """Figures of one function.

    Attributes:
        place: File, line and name, such as `mhsb_sim/circuit.py:12 step`.
        lines: Number of lines, docstring included.
        complexity: 1 + number of branches.
        parameters: Number of parameters without `self` and `cls`.
        undocumented: Whether it has six lines or more and no docstring.
    """

    place: str
    lines: int
    complexity: int
    parameters: int
    undocumented: bool


def installed_modules() -> Iterator[Path]:
    """Yield the Python files of all packages, without tests and set-up files.

    Yields:
        Paths below `SOURCES`, sorted.
    """
    for file in sorted(SOURCES.rglob("*.py")):
        parts = file.relative_to(SOURCES).parts
        if "test" not in parts and len(parts) > 2:
            yield file


def count_statements(tree: ast.AST) -> int:
    """Count statements; docstrings, and other strings that stand alone, do not count."""
    docstrings = sum(
        1
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
    return sum(isinstance(node, ast.stmt) for node in ast.walk(tree)) - docstrings


def complexity_of(function: FunctionNode) -> int:
    """Return 1 + the number of branches; each operand of `and` and `or` after the first counts.

    Args:
        function: Syntax tree of the function; nested functions count with it.

    Returns:
        The complexity, at least 1.
    """
    branches = sum(isinstance(node, BRANCHES) for node in ast.walk(function))
    operands = sum(
        len(node.values) - 1 for node in ast.walk(function) if isinstance(node, ast.BoolOp)
    )
    return 1 + branches + operands


def parameter_count(function: FunctionNode) -> int:
    """Count the parameters of all kinds without `self` and `cls`.

    Args:
        function: Syntax tree of the function.

    Returns:
        The number; `*args` and `**kwargs` count as one each.
    """
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    extra = sum(each is not None for each in (given.vararg, given.kwarg))
    return len([name for name in names if name not in ("self", "cls")]) + extra


def figures_of(file: Path, tree: ast.AST) -> Iterator[FunctionFigures]:
    """Yield the figures of each function in a file, including methods and nested functions.

    Args:
        file: The file, below `SOURCES`.
        tree: Its syntax tree.

    Yields:
        Figures of each function, in the order of `ast.walk`.
    """
    for node in ast.walk(tree):
        if isinstance(node, FunctionNode):
            assert node.end_lineno is not None
            body_lines = node.end_lineno - node.body[0].lineno + 1
            silent = ast.get_docstring(node) is None and body_lines >= LONG_BODY
            place = f"{file.relative_to(SOURCES)}:{node.lineno} {node.name}"
            yield FunctionFigures(
                place,
                node.end_lineno - node.lineno + 1,
                complexity_of(node),
                parameter_count(node),
                silent,
            )


def tuned_numbers_of(tree: ast.AST) -> Iterator[str]:
    """Yield the docstring of each tuned number in a file.

    Args:
        tree: Syntax tree of the file.

    Yields:
        Docstrings with an origin, of the fields of classes named `…Settings`.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and node.name.endswith("Settings"):
            for each in node.body[1:]:
                if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
                    text = str(each.value.value)
                    if "Origin:" in text:
                        yield text


def measure() -> tuple[dict[str, Any], list[FunctionFigures]]:
    """Measure all installed packages.

    Returns:
        Figures by name, ready for JSON, and the figures of each function.
    """
    statements: dict[str, int] = defaultdict(int)
    functions: list[FunctionFigures] = []
    classes: dict[str, list[str]] = defaultdict(list)
    tuned: list[str] = []
    files = 0
    for file in installed_modules():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        files += 1
        statements[file.relative_to(SOURCES).parts[0]] += count_statements(tree)
        functions += figures_of(file, tree)
        tuned += tuned_numbers_of(tree)
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes[node.name].append(str(file.relative_to(SOURCES)))
    same = {name: places for name, places in classes.items() if len(places) > 1}
    figures = {
        "files": files,
        "functions": len(functions),
        "statements": sum(statements.values()),
        "statements_by_package": dict(statements),
        "longest_function_lines": max(each.lines for each in functions),
        "largest_complexity": max(each.complexity for each in functions),
        "functions_with_many_parameters": sum(
            each.parameters >= MANY_PARAMETERS for each in functions
        ),
        "most_parameters": max(each.parameters for each in functions),
        "undocumented_functions": sum(each.undocumented for each in functions),
        "class_names_defined_twice": dict(sorted(same.items())),
        "tuned_numbers": len(tuned),
        "tuned_numbers_with_sensitivity": sum(
            "RMS" in text or "no effect" in text for text in tuned
        ),
    }
    return figures, functions


def main(json_: Annotated[bool, tyro.conf.arg(name="json")] = False, worst: int = 5) -> int:
    """Print the figures of the installed packages.

    Args:
        json_: Print one JSON object instead of text.
        worst: Number of functions to list for each figure.

    Returns:
        Exit code 0.
    """
    figures, functions = measure()
    if json_:
        print(json.dumps(figures, indent=1))
        return 0
    for name, value in figures.items():
        if isinstance(value, dict):
            print(f"{name} ({len(value)}):")
            for key, each in value.items():
                print(f"    {key}: {each if isinstance(each, int) else ', '.join(each)}")
        else:
            print(f"{name}: {value}")
    for figure in ("lines", "complexity", "parameters"):
        ordered = sorted(functions, key=lambda each: getattr(each, figure), reverse=True)
        print(f"most {figure}:")
        for each in ordered[:worst]:
            print(f"    {getattr(each, figure):4d}  {each.place}")
    print("undocumented, six lines and more:")
    for each in [each for each in functions if each.undocumented][:worst]:
        print(f"    {each.place}")
    return 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
