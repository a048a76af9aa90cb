"""Registry of all planners by name. A new planner is entered here and nowhere else."""

from typing import TYPE_CHECKING, Literal

from mhsb_planner.errors import RequestError
from mhsb_planner.planners.fixed import FixedPlanner
from mhsb_planner.planners.integrated import IntegratedPlanner
from mhsb_planner.planners.path_planner import PathPlanner
from mhsb_planner.planners.table import TablePlanner

REGISTERED_PLANNERS: dict[str, PathPlanner] = {
    planner.name: planner
    for planner in (
        TablePlanner(),
        FixedPlanner(),
        IntegratedPlanner(),
    )
}
"""All planners by name."""

PLANNER_KINDS: tuple[str, ...] = tuple(REGISTERED_PLANNERS)
"""Names of all planners, in the order of registration."""

if TYPE_CHECKING:
    PlannerKind = str
else:  # tyro reads the choices of a command from it
    PlannerKind = Literal[PLANNER_KINDS]


def get_planner(name: str) -> PathPlanner:
    """Return the registered planner of a given name.

    Args:
        name: Key of REGISTERED_PLANNERS.

    Returns:
        The planner; all callers share it.

    Raises:
        RequestError: No planner has this name; the message lists the names.
    """
    if name not in REGISTERED_PLANNERS:
        raise RequestError(
            "planner", repr(name), f"must be one of: {', '.join(REGISTERED_PLANNERS)}"
        )
    return REGISTERED_PLANNERS[name]


def planner_summaries() -> str:
    """Return one text with name and summary of each planner, joined by semicolons."""
    return "; ".join(
        f"{planner.name} {planner.summary}" for planner in REGISTERED_PLANNERS.values()
    )


def planners_weighing_area() -> str:
    """Return the names of the planners that accept an area weight, quoted and joined by "or"."""
    able = (f"'{planner.name}'" for planner in REGISTERED_PLANNERS.values() if planner.weighs_area)
    return " or ".join(able)


def planners_using(option: str) -> str:
    """Return the names of the planners that use an option, joined by "or"."""
    return " or ".join(
        planner.name for planner in REGISTERED_PLANNERS.values() if option in planner.takes
    )
