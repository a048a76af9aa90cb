"""The paper's cases (Table 2): start, goal, weights and planner of each."""

from dataclasses import dataclass

import numpy as np

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.yaml_files import read_yaml
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, Position
from mhsb_planner.errors import RequestError
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.posture.s1_global_search import find_postures_at
from mhsb_planner.search.fixed_j3 import compute_fixed_j3_posture
from mhsb_planner.search.s2_search import Weights

CASES_FILE = "paper_cases.yaml"
"""Name of the configuration file with the cases."""


@dataclass(frozen=True)
class PaperCase:
    """One of the paper's cases.

    Attributes:
        name: Name of the case, such as `1-1`.
        start: Tip position at the start [m].
        goal: Tip position at the goal [m].
        weights: Weights of energy, time and mode switches.
        planner: Name of the planner.
        initial_j3: Angle at which the conventional method (`fixed`) keeps joint 3 [rad]. None:
            joint 3 keeps its angle in the posture table's start posture.
    """

    name: str
    start: Position
    goal: Position
    weights: Weights
    planner: str = "table"
    initial_j3: float | None = None

    def start_posture(self, machine: Machine) -> FloatArray:
        """Compute the posture at rest from which the case is planned.

        The tip is at `start`. If the planner is `fixed` and `initial_j3` is given, joint 3 has that
        angle. If the other joints have no solution at this angle, joint 3 is moved away from it in
        steps of 1° until there is one.

        In all other cases, the result is the posture with the largest velocity polytope while all
        actuators are in mode N (main pump alone). The polytope contains all tip velocities that the
        pistons allow. If the machine slews, the slew angle is the nearest to 0 at which the tip is
        at `start`.

        Args:
            machine: The machine; it may slew.

        Returns:
            The posture, shape (n,) [rad or m].

        Raises:
            OutOfWorkspaceError: No angle within the slew's limits points to `start`.
            InfeasibleGoalError: No posture within the joint limits reaches `start`.
            RequestError: `initial_j3` is beyond the limits of joint 3.
        """
        place = machine.convert_to_plane(self.start, preferred_slew=0.0)
        if self.planner == "fixed" and self.initial_j3 is not None:
            posture = compute_fixed_j3_posture(machine.planar_arm, *place.tip, self.initial_j3)
        else:
            posture = find_postures_at(machine.planar_arm, *place.tip).posture[0]
        return posture if place.slew is None else np.append(place.slew, posture)

    @property
    def options(self) -> PlanOptions:
        """Options of the case's plan."""
        return PlanOptions(weights=self.weights, planner=self.planner, initial_j3=self.initial_j3)


def load_paper_cases() -> dict[str, PaperCase]:
    """Return all cases by name, such as `1-1`, from the configuration file."""
    content = read_yaml(find_config_file(CASES_FILE))
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


def get_paper_case(name: str) -> PaperCase:
    """Return the case of a given name.

    Args:
        name: Name of the case, such as `1-1`.

    Returns:
        The case.

    Raises:
        RequestError: No case has this name; the message lists the names.
    """
    cases = load_paper_cases()
    if name not in cases:
        raise RequestError("case", name, f"must be one of {', '.join(cases)}")
    return cases[name]
