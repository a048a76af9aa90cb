"""Writes the pages that follow from the code, such as parameters and options.

    python docs/reference.py

A test compares them with what they would be now.
"""

from __future__ import annotations

import importlib
import inspect
import io
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin
from unittest import mock

import griffe
import rclpy
from pydantic import TypeAdapter
from rclpy.node import Node

from mhsb_control.registry import MachineConfigWithGains
from mhsb_model import schema
from mhsb_msgs_py import parameters
from mhsb_planner.online.goal_states import GOAL_TRANSITIONS, GoalState, Transition
from mhsb_planner.ros import planner_parameters
from mhsb_sim.circuit.valves.registry import PORT_VALVE_KINDS, VALVE_KINDS
from mhsb_sim.ros import sim_parameters
from mhsb_tools.executables import SUBCOMMAND_TABLE

FOLDER = Path(__file__).resolve().parent
OF_SEVERAL_KINDS = ("joints.0", "link", "limits", "linkage")
HELP_COLUMNS = 100
GENERATED = "<!-- written by docs/reference.py -->\n"


# --- Parameters of the nodes ---------------------------------------------------------------------


def parameters_page() -> str:
    """Return the page of all parameters that both nodes declare."""
    return f"""# Parameters of the nodes

{GENERATED}
`ros2 run mhsb_planner planner_node --ros-args -p NAME:=VALUE` sets one at the start,
`mhsb param set mhsb_planner NAME VALUE` later. A change applies to the next plan; an impossible one
is refused with a reason. *Fixed* parameters are read only at the start. Defaults that depend on the
machine are those of the suite's own arm.

## `mhsb_planner planner_node`

{_table(_planner_parameters)}

## `mhsb_sim sim_node`

{_table(_simulator_parameters)}
"""


def _planner_parameters(node: Node) -> None:
    machine = parameters.declare_machine(node)
    planner_parameters.declare_table_path(node)
    planner_parameters.declare_frame_prefix(node)
    planner_parameters.declare_changeable(node, machine)


def _simulator_parameters(node: Node) -> None:
    machine = parameters.declare_machine(node)
    plant = sim_parameters.declare_plant(node, machine)
    sim_parameters.declare_parameters(node, machine, plant)


def _table(declare: Callable[[Node], None]) -> str:
    """Return a Markdown table of the parameters that a function declares at a node."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("mhsb_reference", context=context, start_parameter_services=False)
    try:
        inherited = set(node.get_parameters_by_prefix("")) | {"use_sim_time"}
        declare(node)
        own = [name for name in node.get_parameters_by_prefix("") if name not in inherited]
        rows = "\n".join(_parameter_row(node, name) for name in own)
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)
    return f"| name | default | range | meaning |\n|---|---|---|---|\n{rows}"


def _parameter_row(node: Node, name: str) -> str:
    """Return the row of a parameter: name, default, range and meaning."""
    told = node.describe_parameter(name)
    ranges = [*told.floating_point_range, *told.integer_range]
    limits = [f"{_text(each.from_value)} … {_text(each.to_value)}" for each in ranges]
    limits += ["fixed"] * told.read_only
    default, meaning = _code(node.get_parameter(name).value), _cell(told.description)
    return f"| `{name}` | {default} | {'; '.join(limits)} | {meaning} |"


# --- The machine file ----------------------------------------------------------------------------


def machine_file_page() -> str:
    """Every key of a machine file, with range, unit and meaning."""
    chapters = [*_sections("", MachineConfigWithGains)]
    for kind in (*VALVE_KINDS, *PORT_VALVE_KINDS):
        if kind.section is not None:
            chapters += _sections(f"circuit.valves.{kind.name}", kind.section)
    sections = "\n\n".join(dict.fromkeys(chapters))
    boosters = ", ".join(f"`{name}`" for name in schema.BOOSTER_VALUES["circuit"])
    return f"""# The machine file

{GENERATED}
[`config/mhsb_arm3.yaml`](../config/mhsb_arm3.yaml) is an example, and
[your machine](your_machine.md) shows how to write your own. All values are in SI units. Unknown
keys and numbers that are not finite are refused. All errors are listed at once, by path. Keys with
a default may be left out. A machine without booster modules (`hydraulics.modules.count: 0`) may
also leave out `hydraulics.modules.per_mode`, `hydraulics.servo_pump`, and of `circuit`:
{boosters}.

{sections}
"""


def _sections(path: str, model: type[schema.Section]) -> Iterator[str]:
    """Yield a chapter for a section and for each section in it."""
    rows, below = [], []
    for name, field in model.model_json_schema()["properties"].items():
        inner = _models(model.model_fields[name].annotation)
        place = f"{path}.{name}" if path else name
        many = field.get("type") == "array" and bool(inner)
        rows.append(_key_row(name, field, bool(inner), place))
        below += [(place + (".0" if many else ""), each) for each in inner]
    title = f"`{path}`" if path else "Top level"
    kinds = f" ({model.__name__})" if path.endswith(OF_SEVERAL_KINDS) else ""
    text = _cell(inspect.cleandoc(model.__doc__ or "").replace("\n\n", " "))
    header = "| key | values | default | meaning |\n|---|---|---|---|\n"
    yield f"## {title}{kinds}\n\n{text}\n\n{header}" + "\n".join(rows)
    for place, each in below:
        yield from _sections(place, each)


def _models(annotation: Any) -> list[type[schema.Section]]:
    """Sections that a type is made of."""
    if inspect.isclass(annotation) and issubclass(annotation, schema.Section):
        return [annotation]
    found: list[type[schema.Section]] = []
    for argument in getattr(annotation, "__args__", ()):
        found += _models(argument)
    return found


def _key_row(name: str, field: dict[str, Any], is_section: bool, place: str) -> str:
    """Return the row of a key of the machine file: name, values, default and meaning."""
    default = _code(field["default"]) if "default" in field and not is_section else ""
    if is_section:
        values = f"section `{place}`" + (", one for each" if field.get("type") == "array" else "")
        default = "empty" if "default" in field else ""
    else:
        values = _values(field)
    return f"| `{name}` | {values} | {default} | {_cell(field.get('description', ''))} |"


def _values(field: dict[str, Any]) -> str:
    """Return a text of the values that a key takes."""
    options = [option for option in field.get("anyOf", ()) if option.get("type") != "null"]
    if options:
        return _values(options[0])
    if "const" in field:
        return _code(field["const"])
    if "enum" in field:
        return ", ".join(_code(each) for each in field["enum"])
    if field.get("type") == "array":
        return f"list of: {_values(field.get('items') or field['prefixItems'][0])}"
    if field.get("type") == "object":
        return "a section for each name"
    low, high = field.get("minimum"), field.get("maximum")
    bounds = []
    if "exclusiveMinimum" in field:
        bounds.append(f"> {_text(field['exclusiveMinimum'])}")
    if low is not None:
        bounds.append(f"≥ {_text(low)}")
    if high is not None:
        bounds.append(f"≤ {_text(high)}")
    kind = {"integer": "integer", "boolean": "true, false", "string": "text"}.get(
        field.get("type", ""), "number"
    )
    return f"{kind} {', '.join(bounds)}".strip()


# --- States of a goal ----------------------------------------------------------------------------


def goal_states_page() -> str:
    """Return the page with the states of a goal and what each event does in each of them."""
    states = "\n".join(f"| {each.name.lower()} | {each.value} |" for each in GoalState)
    places = [each for each in GoalState if each is not GoalState.ENDED]
    rows = "\n".join(
        f"| {event} | {' | '.join(_transition(effects.get(each)) for each in places)} |"
        for event, effects in GOAL_TRANSITIONS.items()
    )
    header = f"| event | {' | '.join(each.name.lower() for each in places)} |"
    return f"""# The states of a goal

{GENERATED}
A goal is in one of these states. If the arm executes a plan for it while a further plan for it is
made, the state is *executing*. [contracts.md](contracts.md#the-life-of-a-goal) says it in full.

| state | meaning |
|---|---|
{states}

Each cell says which report the goal gets, the state that follows, and what else happens. Codes in
capitals are verdicts, the others execution reports. An empty cell means that the goal keeps its
state and gets no report. `mhsb_planner.online.goal_states` has the table; a test brings a goal into
each state, lets each event happen, and compares.

{header}
|{"---|" * (len(places) + 1)}
{rows}
"""


def _transition(transition: Transition | None) -> str:
    """Return the text of a cell; empty for None."""
    if transition is None:
        return ""
    report = f"`{transition.report}`" if transition.report else ""
    state = f"→ {transition.next_state.name.lower()}"
    return ", ".join(filter(None, (report, state, transition.action)))


# --- Interfaces of parts that a user adds --------------------------------------------------------

INTERFACES: dict[str, tuple[str, ...]] = {
    "For all": (
        "mhsb_model.machine.Machine: config arrays joint_count patterns tip_position tip_positions "
        "end_link_angle jacobian postures cylinder_lengths moment_arms piston_forces mass_matrix "
        "clearance changed with_values",
        "mhsb_model.arrays.MachineArrays: joint_min joint_max linkage cap_area rod_area payload "
        "supply_pressure tank_pressure main_pump_flow servo_pump_flow valve_coefficient "
        "leakage_flow max_piston_speed",
        "mhsb_model.trajectory.MotionState: position velocity acceleration at_rest",
    ),
    "For a planner": (
        "mhsb_planner.planners.path_planner.PathPlanner",
        "mhsb_planner.planners.path_planner.PathRequest: goal planar_goal start departure modes "
        "options begins_at_goal",
        "mhsb_planner.motion.s4_mode_schedule.StartModes: modes age",
        "mhsb_planner.planners.options.PlanOptions",
        "mhsb_planner.search.s2_graph.StepGraph: machine table layout",
        "mhsb_planner.progress.PlanProgress: has_motion search_deadline",
        "mhsb_planner.deadline.Deadline: check remaining has_passed",
        "mhsb_planner.integrated.goal_postures.sample_goal_postures",
        "mhsb_planner.integrated.goal_postures.GoalPostures: tip tips posture length",
        "mhsb_model.linkages.linkage.find_joint_angle",
        "mhsb_planner.planners.priced_path.price_path",
        "mhsb_planner.search.s2_step.compute_step_costs",
        "mhsb_planner.search.s2_step.StepCosts",
        "mhsb_planner.search.discrete_path.DiscretePath: tip posture modes duration energy "
        "energy_series cost start_modes statistics create_without_steps",
        "mhsb_planner.search.discrete_path.SearchStatistics: expanded generated seconds",
        "mhsb_planner.planners.path_planner.PathProposal",
        "mhsb_planner.errors.NoPathError",
    ),
    "For a controller": (
        "mhsb_control.controller.Controller: gains_section usual_error preview reads_pressures "
        "supervision_limits __init__ estimates update",
        "mhsb_control.controller.LearningController",
        "mhsb_control.controller.ServoSignals",
        "mhsb_control.controller.ActuatorReadings",
        "mhsb_model.circuit.components.Components",
        "mhsb_model.circuit.quantities.ActuatorState: valve_command join_command",
        "mhsb_model.circuit.quantities.ModuleState: flow_command to_rail_command flow",
        "mhsb_model.circuit.quantities.CylinderConstants",
        "mhsb_model.arm_reports.Estimate",
        "mhsb_control.natural_frequency.find_joint_frequency_ranges",
        "mhsb_model.hydraulics.compute_extension_speed",
        "mhsb_model.hydraulics.compute_retraction_speed",
    ),
    "For a limit": (
        "mhsb_planner.motion.limits.limit.LimitInputs",
        "mhsb_planner.motion.limits.limit.Limit",
        "mhsb_planner.motion.limits.limit.StateLimit",
    ),
    "For a valve": (
        "mhsb_sim.circuit.valves.valve_kind.ValveKind",
        "mhsb_sim.circuit.valves.valve_kind.ValvePlace",
        "mhsb_sim.circuit.valves.valve_kind.PortValveKind",
        "mhsb_sim.circuit.valves.valve_kind.PortValvePlace",
        "mhsb_sim.circuit.valves.valve_kind.CircuitSite",
        "mhsb_model.circuit.elements.compute_orifice_flow",
        "mhsb_model.circuit.elements.compute_check_valve_flow",
        "mhsb_model.circuit.elements.compute_relief_valve_flow",
        "mhsb_model.circuit.quantities.CircuitConstants: laminar_pressure tank_pressure "
        "supply_pressure substep",
    ),
}
"""Classes and functions of each chapter; after a colon the members that are listed, else all."""


def interfaces_page() -> str:
    """Return the page of the objects that planners, controllers and valves get and return."""
    chapters = []
    for title, entries in INTERFACES.items():
        chapters.append(f"## {title}")
        chapters += [_interface(*entry.partition(": ")[::2]) for entry in entries]
    text, ranges = "\n\n".join(chapters), "\n".join(_key_types())
    return f"""# What do planners, controllers, limits and valves get and return?

{GENERATED}
[Extending](extending.md) says how to write and register them. n is the number of joints, which is
that of actuators. The [Python interface](api/model.md) has all other classes and functions.

## Types of keys

A key of a machine file, such as a gain, takes its range from one of these types of
`mhsb_model.schema`, or from a `Field` of pydantic.

| name | values |
|---|---|
{ranges}

{text}
"""


def _key_types() -> Iterator[str]:
    """Yield the row of each type of a number in the machine file."""
    for name, kind in vars(schema).items():
        if get_origin(kind) is Annotated and get_args(kind)[0] is float:
            yield f"| `{name}` | {_values(TypeAdapter(kind).json_schema())} |"


def _interface(name: str, members: str) -> str:
    """Return the chapter of a class or a function: its module, its docstring and its parts.

    Args:
        name: Full name.
        members: Names of the members of a class that are listed, apart by blanks; empty for all
            public ones.
    """
    place, _, own = name.rpartition(".")
    file = importlib.import_module(place).__file__ or ""
    options = {"returns_multiple_items": False, "warnings": False}
    module = griffe.visit(
        place, Path(file), Path(file).read_text(), docstring_parser="google",
        docstring_options=options,
    )  # fmt: skip
    found = module[own]
    text, rows = _docstring(found)
    title = own
    if found.is_function:
        title = _call(found)
    elif list(found.members) == ["__init__"]:
        title, rows = _call(found["__init__"], own), _docstring(found["__init__"])[1]
    else:
        wanted = members.split() or [*rows, *(n for n in found.members if not n.startswith("_"))]
        rows = {each: rows.get(each) or _member_row(found[each]) for each in dict.fromkeys(wanted)}
    header = "| name | type | meaning |\n|---|---|---|\n"
    return f"### `{title}`\n\n`{place}`. {text}\n\n{header}" + "\n".join(rows.values())


def _member_row(member: Any) -> str:
    """Return the row of an attribute, a property or a method of a class."""
    text, rows = _docstring(member)
    if not member.is_function:
        return f"| `{member.name}` | {_type(member.annotation)} | {text} |"
    arguments = (row.split(" | ", 2) for row in rows.values())
    meanings = " ".join(f"{name[2:]}: {meaning[:-2]}" for name, _, meaning in arguments)
    return f"| `{_call(member)}` | {_type(member.returns)} | {f'{text} {meanings}'.strip()} |"


def _docstring(found: Any) -> tuple[str, dict[str, str]]:
    """Return a docstring without examples, and the rows of its arguments or attributes by name."""
    text, rows = [], {}
    for section in found.docstring.parsed if found.docstring else ():
        value, kind = section.value, section.kind.value
        if kind == "text" and not text:
            text.append(_cell(value.partition("\n\n")[0]))
        elif kind in ("attributes", "parameters"):
            for each in value:
                cells = f"{_type(each.annotation)} | {_cell(each.description)}"
                rows[each.name] = f"| `{each.name}` | {cells} |"
        elif kind == "returns":
            text.append(f"Returns: {_cell(value[0].description)}")
        elif kind == "raises":
            text += [f"Raises `{each.annotation}`: {_cell(each.description)}" for each in value]
    return " ".join(text), rows


def _call(function: Any, name: str = "") -> str:
    """Return a call of a function: its name, and its arguments with their defaults."""
    arguments = (
        each.name if each.default is None else f"{each.name}={each.default}"
        for each in function.parameters
        if each.name not in ("self", "cls")
    )
    return f"{name or function.name}({', '.join(arguments)})"


def _type(annotation: Any) -> str:
    """Return the cell of a type; empty if there is none."""
    return f"`{_cell(str(annotation))}`" if annotation is not None else ""


# --- Text ----------------------------------------------------------------------------------------


def _code(value: Any) -> str:
    if value in ("", None) or value == [] or (hasattr(value, "__len__") and len(value) == 0):
        return "empty"
    if isinstance(value, (list, tuple)) or hasattr(value, "tolist"):
        return f"`[{', '.join(_text(each) for each in value)}]`"
    return f"`{_text(value)}`"


def _text(value: Any) -> str:
    """Format a value as YAML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return ".nan" if math.isnan(value) else f"{value:.6g}"
    return str(value)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


# --- Options of the commands ---------------------------------------------------------------------


def options_page() -> str:
    """Return the page with the help of every subcommand of `mhsb`."""
    parts = [_subcommand_part(name, entry) for name, (entry, _) in SUBCOMMAND_TABLE.items()]
    return f"""# Options of the commands

{GENERATED}
What `mhsb SUBCOMMAND --help` prints. [Commands](commands.md) says which there are.
{"".join(parts)}"""


def _subcommand_part(name: str, entry: Callable[[], int]) -> str:
    """Return the part of one subcommand, as its help is on a terminal of HELP_COLUMNS."""
    module = inspect.getclosurevars(entry).nonlocals["module"]
    text = io.StringIO()
    terminal = mock.patch.dict(os.environ, {"COLUMNS": str(HELP_COLUMNS)})
    words = mock.patch.object(sys, "argv", [f"mhsb {name}", "--help"])
    with terminal, words, redirect_stdout(text), suppress(SystemExit):
        importlib.import_module(module).main()
    lines = "\n".join(line.rstrip() for line in text.getvalue().strip().splitlines())
    return f"\n## `mhsb {name}`\n\n```text\n{lines}\n```\n"


PAGES = {
    "options.md": options_page,
    "parameters.md": parameters_page,
    "machine_file.md": machine_file_page,
    "goal_states.md": goal_states_page,
    "interfaces.md": interfaces_page,
}


def main() -> None:
    """Write all of them."""
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
