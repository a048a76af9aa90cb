"""Kernels that borrow are compiled without counting references: what would need them is refused."""

import ast
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "ros2_ws" / "src").glob("*/mhsb_*/**/*.py"))
MAKES_NO_ARRAY = {"np.isnan", "np.isfinite", "np.searchsorted", "np.rint"}
"""Of a single value."""


@dataclass(frozen=True)
class Source:
    """A kernel as it is written."""

    function: ast.FunctionDef
    options: dict[str, object]

    @property
    def returns(self) -> set[str]:
        """Names of the types that it returns."""
        return names_in(self.function.returns)

    @property
    def calls(self) -> set[str]:
        """What it calls, as it is written."""
        calls = (each for each in ast.walk(self.function) if isinstance(each, ast.Call))
        return {ast.unparse(each.func) for each in calls}


def names_in(node: ast.AST | None) -> set[str]:
    if node is None:
        return set()
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


def statements() -> list[ast.stmt]:
    return [each for file in SOURCES for each in ast.parse(file.read_text("utf-8")).body]


def holders_of_arrays(body: list[ast.stmt]) -> set[str]:
    """Array types, and classes with a field of such a type."""
    classes = {each.name: each for each in body if isinstance(each, ast.ClassDef)}
    fields = {
        name: set().union(
            *(names_in(each.annotation) for each in made.body if isinstance(each, ast.AnnAssign))
        )
        for name, made in classes.items()
    }
    held = {"FloatArray", "IntArray", "ModeArray", "BoolArray", "Records", "ndarray", "np"}
    while more := {name for name, types in fields.items() if types & held} - held:
        held |= more
    return held


def kernels(body: list[ast.stmt]) -> dict[str, list[Source]]:
    """All kernels by name."""
    found: dict[str, list[Source]] = {}
    for each in body:
        for by in each.decorator_list if isinstance(each, ast.FunctionDef) else ():
            call = by if isinstance(by, ast.Call) else ast.Call(by, [], [])
            if ast.unparse(call.func) == "kernel":
                options = {word.arg: ast.literal_eval(word.value) for word in call.keywords}
                found.setdefault(each.name, []).append(Source(each, options))
    return found


BODY = statements()
ARRAYS, KERNELS = holders_of_arrays(BODY), kernels(BODY)
BORROWING = [each for named in KERNELS.values() for each in named if each.options.get("borrows")]


@pytest.mark.parametrize("source", BORROWING, ids=lambda each: each.function.name)
def test_a_kernel_that_borrows_neither_makes_nor_returns_arrays(source: Source) -> None:
    assert not source.returns & ARRAYS
    for called in source.calls:
        assert not called.startswith("np.") or called in MAKES_NO_ARRAY
        assert not called.endswith(".copy")
        for other in KERNELS.get(called, ()):
            inlined = other.options.get("inline") == "always"
            assert inlined or not other.returns & ARRAYS, f"{called} returns arrays"


def test_there_are_kernels_that_borrow_and_kernels_that_must_not() -> None:
    assert len(BORROWING) > 50
    assert {"MachineArrays", "Chain", "PumpState"} <= ARRAYS
    assert "SharedHydraulics" not in ARRAYS
    assert any(each.returns & ARRAYS for named in KERNELS.values() for each in named)
