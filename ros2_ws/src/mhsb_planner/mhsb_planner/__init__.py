"""Motion planner: posture table, search for path and modes, trajectory, mode schedule."""

from typing import TYPE_CHECKING

from mhsb_model import import_on_use

if TYPE_CHECKING:
    from mhsb_planner.deadline import Deadline as Deadline
    from mhsb_planner.plan import Plan as Plan
    from mhsb_planner.planner import Planner as Planner
    from mhsb_planner.planners.options import PlanOptions as PlanOptions
    from mhsb_planner.posture.posture_table_cache import load_or_build_table as load_or_build_table
    from mhsb_planner.posture.s1_global_search import build_posture_table as build_posture_table
    from mhsb_planner.posture.s1_posture_table import PostureTable as PostureTable
    from mhsb_planner.search.s2_search import Weights as Weights

__getattr__, __dir__ = import_on_use(
    __name__,
    {
        "Deadline": "mhsb_planner.deadline",
        "Plan": "mhsb_planner.plan",
        "Planner": "mhsb_planner.planner",
        "PlanOptions": "mhsb_planner.planners.options",
        "load_or_build_table": "mhsb_planner.posture.posture_table_cache",
        "build_posture_table": "mhsb_planner.posture.s1_global_search",
        "PostureTable": "mhsb_planner.posture.s1_posture_table",
        "Weights": "mhsb_planner.search.s2_search",
    },
)
