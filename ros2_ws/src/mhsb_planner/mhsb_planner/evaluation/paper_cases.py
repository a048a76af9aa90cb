"""The paper's cases (Table 2): where they start and end, what they weigh, how they are planned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.files.config_files import config_file
from mhsb_model.files.yaml_files import read_yaml
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, Position
from mhsb_planner.errors import RequestError
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.posture.s1_global_search import postures_at
from mhsb_planner.search.fixed_j3 import fixed_j3_posture
from mhsb_planner.search.s2_search import Weights

CASES_FILE = "paper_cases.yaml"


@dataclass(frozen=True)
class PaperCase:
    """A case: tip positions [m] at start and goal, weights of the cost, and the planner.

    initial_j3 [rad] is where the conventional method (`fixed`) keeps joint 3; None keeps it where
    the posture table has it at the start.
    """

    name: str
    start: Position
    goal: Position
    weights: Weights
    planner: str = "table"
    initial_j3: float | None = None

    def start_posture(self, machine: Machine) -> FloatArray:
        """Posture at rest from which the case is planned [rad]: in N, or with the initial J3."""
        place = machine.in_plane(self.start, near=0.0)
        if self.planner == "fixed" and self.initial_j3 is not None:
            posture = fixed_j3_posture(machine.plane, *place.tip, self.initial_j3)
        else:
            posture = postures_at(machine.plane, *place.tip).posture[0]
        return posture if place.slew is None else np.append(place.slew, posture)

    @property
    def options(self) -> PlanOptions:
        """What the case's plan is to be like."""
        return PlanOptions(
            weights=self.weights, planner=self.planner, initial_j3=self.initial_j3
        )


def paper_cases() -> dict[str, PaperCase]:
    """All cases by name, such as `1-1`."""
    content = read_yaml(config_file(CASES_FILE))
    return {
        name: PaperCase(
            name=name,
            start=tuple(case["start"]),
            goal=tuple(case["goal"]),
            weights=Weights(*case["weights"]),
            planner=case.get("planner", "table"),
            initial_j3=case.get("initial_j3"),
        )
        for name, case in content.items()
    }


def paper_case(name: str) -> PaperCase:
    """One case; RequestError with the names that there are."""
    cases = paper_cases()
    if name not in cases:
        raise RequestError("case", name, f"must be one of {', '.join(cases)}")
    return cases[name]
