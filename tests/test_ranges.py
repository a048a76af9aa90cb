"""Every number that a user can set has a finite range, and one sentence for what is beyond it."""

from __future__ import annotations

import copy
import importlib
import inspect
import math
import pkgutil
from dataclasses import is_dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import pytest
import yaml
from pydantic.fields import FieldInfo

import mhsb_control
import mhsb_model
import mhsb_planner
import mhsb_sim
import mhsb_tools
from mhsb_control import load_machine
from mhsb_control.registry import MachineConfigWithGains
from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.errors import MachineFileError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_model.schema import Section

PACKAGES = (mhsb_model, mhsb_control, mhsb_planner, mhsb_sim, mhsb_tools)
ARMS = (
    "mhsb_arm3", "mhsb_arm3_published", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane"
)  # fmt: skip


ROOT = Path(__file__).resolve().parents[1]


def modules():
    """All modules of the packages, of the benchmarks and of the soak."""
    for package in PACKAGES:
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            yield importlib.import_module(found.name)
    for folder in ("benchmarks", "tests/soak"):
        for file in sorted((ROOT / folder).glob("[a-z]*.py")):
            yield importlib.import_module(f"{folder.replace('/', '.')}.{file.stem}")


def sections(model: type[Section] = Section):
    """All classes of sections of files, wherever they are defined."""
    for each in model.__subclasses__():
        yield each
        yield from sections(each)


def numbers_in(kind: Any, metadata: tuple[Any, ...] = ()):
    """Each type of number in an annotation with the metadata that holds for it."""
    if get_origin(kind) is Annotated:
        inner, *own = get_args(kind)
        flat = [
            one
            for each in own
            for one in (each.metadata if isinstance(each, FieldInfo) else [each])
        ]
        yield from numbers_in(inner, (*metadata, *flat))
    elif kind in (int, float):
        yield kind, metadata
    elif get_origin(kind) is not None:
        kept = () if get_origin(kind) in (tuple, list, dict) else metadata
        for each in get_args(kind):
            if isinstance(each, type) or get_origin(each) is not None:
                yield from numbers_in(each, kept)


def test_every_number_of_every_file_has_a_finite_range():
    found, without = 0, []
    list(modules())
    for section in set(sections()):
        if not section.__module__.startswith("mhsb_"):
            continue
        hints = get_type_hints(section, include_extras=True)
        for name, field in section.model_fields.items():
            for _, metadata in numbers_in(hints[name], tuple(field.metadata)):
                found += 1
                low = [
                    v
                    for m in metadata
                    for k in ("ge", "gt")
                    if (v := getattr(m, k, None)) is not None
                ]
                high = [
                    v
                    for m in metadata
                    for k in ("le", "lt")
                    if (v := getattr(m, k, None)) is not None
                ]
                if not (low and high and all(map(math.isfinite, (*low, *high)))):
                    without.append(f"{section.__name__}.{name}")
    assert found > 150
    assert without == []


def test_no_number_of_a_file_has_two_limits_of_one_kind():
    """Pydantic would check the one that comes last, not the narrower one."""
    list(modules())
    doubled = [
        f"{section.__name__}.{name}"
        for section in set(sections())
        for name, field in section.model_fields.items()
        if len({type(each) for each in field.metadata}) < len(field.metadata)
    ]
    assert doubled == []


def places(content: Any, path: tuple[Any, ...] = ()):
    """Where numbers stand in a file, as keys."""
    if isinstance(content, dict | list):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in items:
            yield from places(value, (*path, key))
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield path


@pytest.mark.parametrize("name", ARMS)
def test_a_machine_file_is_refused_for_each_number_that_is_far_beyond(name):
    content = yaml.safe_load(find_config_file(f"{name}.yaml").read_text(encoding="utf-8"))
    for path in places(content):
        for value in (1e308, -1e308, 10**70, 1e-320):
            spoiled = copy.deepcopy(content)
            at = spoiled
            for key in path[:-1]:
                at = at[key]
            at[path[-1]] = value
            try:
                MachineConfigWithGains.model_validate(spoiled)
            except ValueError:
                continue
            assert value == 1e-320  # it stands for 0, which many numbers may be
            assert abs(at[path[-1]]) < 1e-300


def test_the_sentence_names_path_value_and_limit(tmp_path):
    content = find_config_file("mhsb_arm3.yaml").read_text(encoding="utf-8")
    file = tmp_path / "arm.yaml"
    file.write_text(content.replace("bulk_modulus: 1.0e9", "bulk_modulus: 1.0e+308"))
    with pytest.raises(MachineFileError) as refused:
        load_machine(file)
    assert str(refused.value) == (
        f"machine file {file}: circuit.bulk_modulus: must be at most 1e+12 Pa (is 1e+308); lower it"
    )


def test_every_text_with_a_pattern_says_what_it_may_hold():
    list(modules())
    found = 0
    for section in set(sections()):
        for name, field in section.model_fields.items():
            if any(getattr(each, "pattern", None) for each in field.metadata):
                found += 1
                assert "only" in (field.description or ""), f"{section.__name__}.{name}"
    assert found > 0


def commands():
    """All functions and classes that some module hands to `command_line.run` or `make_main`."""
    for module in modules():
        main = getattr(module, "main", None)
        if isinstance(main, partial):
            yield module, main.args[0]
            continue
        if main is None or "command_line.run(" not in inspect.getsource(main):
            continue
        first = inspect.getsource(main).split("command_line.run(")[1].split(",")[0].split(")")[0]
        yield module, getattr(module, first)


def arguments_of(command):
    """Name and annotation of every argument of a command, those in groups of options included."""
    for name, kind in get_type_hints(command, include_extras=True).items():
        if is_dataclass(kind):
            yield from arguments_of(kind)
        elif name != "return":
            yield name, kind


def test_every_number_of_every_command_has_a_finite_range():
    found, without = 0, []
    for module, command in commands():
        for name, kind in arguments_of(command):
            ranges = [m for m in getattr(kind, "__metadata__", ()) if isinstance(m, NumberRange)]
            if list(numbers_in(kind)):
                found += 1
                if not ranges or not all(map(math.isfinite, (ranges[0].least, ranges[0].greatest))):
                    without.append(f"{module.__name__}: {name}")
    assert found > 60
    assert without == []


def options_of(command):
    """Options of numbers of a command, and how many words of numbers each takes."""
    for name, kind in arguments_of(command):
        if list(numbers_in(kind)):
            positional = any("Positional" in str(m) for m in getattr(kind, "__metadata__", ()))
            yield name.strip("_").replace("_", "-"), max(1, len(list(numbers_in(kind)))), positional


def test_a_number_far_beyond_is_refused_before_a_command_begins(capsys):
    tried = 0
    for module, command in commands():
        for flag, count, positional in options_of(command):
            for number in ("1e308", "-1e308", "9" * 4000):
                words = [number] * count
                asked = words if positional else [f"--{flag}", *words]
                code = command_line.run(command, asked, name="command", node=True)
                said = capsys.readouterr().err
                assert code == command_line.EXIT_USAGE, f"{module.__name__} {flag}: {said}"
                assert said.count("\n") == 1, said
                assert len(said) < 1000, said
                tried += 1
    assert tried > 150


def test_the_machines_that_ship_are_as_before():
    for name in ARMS:
        assert isinstance(load_machine(find_config_file(f"{name}.yaml")), Machine)
