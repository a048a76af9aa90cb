"""Counterbalance valves, which hold a cylinder's load and let it down against a braking pressure.

    u = (p_L + R p_X − p_set) / Δp_open,   0 ≤ u ≤ 1

u is the opening, p_L the pressure of the chamber, and p_X that of the opposite chamber, the pilot.
R is the pilot ratio. The spring chamber is vented, so that the pressure behind the valve does not
act on it. Pressures are those above tank pressure [Pa].

Source: MathWorks, Simscape Fluids, Counterbalance Valve (IL): force balance of the spool, with a
back pressure ratio of 0. Makers set p_set to 1.3 times the highest load pressure.
"""

from pydantic import Field

from mhsb_model.kernels.kernel import kernel
from mhsb_model.schema import Pressure, Section
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.valves.valve_kind import CircuitSite, PortValveKind, PortValvePlace


class Counterbalance(Section):
    """Counterbalance valves at both chambers of all cylinders, piloted by the opposite chamber."""

    setting: Pressure = Field(description="chamber pressure that opens without pilot, p_set [Pa]")
    pilot_ratio: float = Field(default=3.0, ge=0, le=20, description="R, area of pilot to load [-]")
    opening_range: Pressure = Field(
        default=2e6, description="pressure from shut to fully open, Δp_open [Pa]"
    )
    size: float = Field(
        default=1.0, ge=0.1, le=10, description="coefficient, in those of the servo valve [-]"
    )
    lag: float = Field(default=0.02, ge=1e-3, le=1, description="time constant of the spool [s]")


@kernel(inline="always")
def compute_counterbalance_opening(numbers: FloatArray, chamber: float, pilot: float) -> float:
    """Compute the opening u, 0 … 1; the numbers are p_set, R and Δp_open."""
    return min(max((chamber + numbers[1] * pilot - numbers[0]) / numbers[2], 0.0), 1.0)


def _list_places(site: CircuitSite, section: Counterbalance) -> list[PortValvePlace]:
    """Return two valves for each cylinder."""
    numbers = section.setting, section.pilot_ratio, section.opening_range
    return [
        PortValvePlace(chamber, pilot, section.size * coefficient, section.lag, numbers)
        for j, coefficient in enumerate(site.machine.arrays.valve_coefficient)
        for chamber, pilot in (
            (site.cap_side(j), site.rod_side(j)),
            (site.rod_side(j), site.cap_side(j)),
        )
    ]


COUNTERBALANCE_VALVE = PortValveKind(
    name="counterbalance",
    section=Counterbalance,
    list_places=_list_places,
    compute_opening=compute_counterbalance_opening,
)
"""Counterbalance valves."""
