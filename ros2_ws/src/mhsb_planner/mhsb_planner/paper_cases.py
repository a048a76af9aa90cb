"""The paper's cases (Table 2): where they start and end, and what they weigh."""

from __future__ import annotations

from dataclasses import dataclass

import yaml

from mhsb_model.config_files import config_file
from mhsb_planner.errors import RequestError
from mhsb_planner.s2_search import Weights

CASES_FILE = "paper_cases.yaml"


@dataclass(frozen=True)
class PaperCase:
    """A case: tip positions (x, z) [m] at start and goal, and the weights of its cost."""

    name: str
    start: tuple[float, float]
    goal: tuple[float, float]
    weights: Weights


def paper_cases() -> dict[str, PaperCase]:
    """All cases by name, such as `1-1`."""
    content = yaml.safe_load(config_file(CASES_FILE).read_text(encoding="utf-8"))
    return {
        name: PaperCase(
            name, tuple(case["start"]), tuple(case["goal"]), Weights(*case["weights"])
        )
        for name, case in content.items()
    }


def paper_case(name: str) -> PaperCase:
    """One case; RequestError with the names that there are."""
    cases = paper_cases()
    if name not in cases:
        raise RequestError("case", name, f"must be one of {', '.join(cases)}")
    return cases[name]
