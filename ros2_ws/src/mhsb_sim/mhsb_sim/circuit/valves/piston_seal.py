"""Leakage of the piston seals, from one chamber of a cylinder into the other.

    Q = G Δp

The flow through the gap is laminar. The conductance G follows from `leakage_flow` at 10 MPa. It is
proportional to 1/µ, with the viscosity µ of the oil.

Source: H. E. Merritt, Hydraulic Control Systems (leakage of a piston); M. Jelali, A. Kroll,
Hydraulic Servo-systems (internal leakage of a cylinder).
"""

from pydantic import Field

from mhsb_model.circuit.constants import compute_viscosity_ratio
from mhsb_model.kernels.kernel import kernel
from mhsb_model.schema import Section
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.valves.valve_kind import CircuitSite, ValveKind, ValvePlace

RATED_DROP = 1e7
"""Pressure drop over the seal at which the machine file states its leakage [Pa]."""


class PistonSeal(Section):
    """Piston seals of all cylinders."""

    leakage_flow: float = Field(
        default=2e-9, ge=0, le=1e-3, description="of each seal at 10 MPa [m³/s]"
    )


@kernel(inline="always")
def compute_seal_flow(numbers: FloatArray, drop: float) -> tuple[float, float]:
    """Compute the flow Q = G Δp [m³/s] and its slope G; G is the seal's only number."""
    return numbers[0] * drop, numbers[0]


def _list_places(site: CircuitSite, section: PistonSeal) -> list[ValvePlace]:
    """Return the seal of each piston, between cap side and rod side.

    Args:
        site: Circuit of a machine.
        section: Section `piston_seal` of the machine file, with the leakage of each seal.
    """
    viscosity = compute_viscosity_ratio(site.machine.config.imperfections.oil_temperature)
    conductance = [section.leakage_flow / RATED_DROP / viscosity]
    return [
        ValvePlace(site.cap_side(j), site.rod_side(j), conductance)
        for j in range(site.machine.joint_count)
    ]


PISTON_SEAL = ValveKind(
    name="piston_seal",
    section=PistonSeal,
    list_places=_list_places,
    compute_flow=compute_seal_flow,
)
"""Piston seals."""
