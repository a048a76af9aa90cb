"""All planners, by the names they are asked for by. A new one is entered here, and nowhere else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from mhsb_planner.errors import RequestError
from mhsb_planner.planners.fixed import FixedPlanner
from mhsb_planner.planners.integrated import IntegratedPlanner
from mhsb_planner.planners.path_planner import PathPlanner
from mhsb_planner.planners.table import TablePlanner

PLANNERS: dict[str, PathPlanner] = {
    planner.name: planner for planner in (TablePlanner(), FixedPlanner(), IntegratedPlanner())
}

PLANNER_KINDS: tuple[str, ...] = tuple(PLANNERS)

ONLINE_PLANNER = IntegratedPlanner.name
"""What the node plans with unless told otherwise; cases keep the planner that they name."""

if TYPE_CHECKING:
    PlannerKind = str
else:  # what a command offers to choose from
    PlannerKind = Literal[PLANNER_KINDS]


def planner_named(name: str) -> PathPlanner:
    """The planner of that name; raises RequestError with the names that there are."""
    if name not in PLANNERS:
        raise RequestError("planner", repr(name), f"must be one of: {', '.join(PLANNERS)}")
    return PLANNERS[name]


def summaries() -> str:
    """What each planner does, in one clause each."""
    return "; ".join(f"{planner.name} {planner.summary}" for planner in PLANNERS.values())


def weighing_area() -> str:
    """The planners for which w₄ may be above 0, in quotation marks."""
    able = (f"'{planner.name}'" for planner in PLANNERS.values() if planner.weighs_area)
    return " or ".join(able)


def taking(option: str) -> str:
    """The planners that look at an option which not all of them do."""
    return " or ".join(planner.name for planner in PLANNERS.values() if option in planner.takes)
