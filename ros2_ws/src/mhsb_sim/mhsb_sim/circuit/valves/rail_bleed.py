"""Bleed valve from the rail to the tank, which lets the pressure of an unused rail sink.

    Q = G Δp

The conductance G follows from `circuit.rail_bleed_flow` at 10 MPa. It is proportional to 1/µ, with
the viscosity µ of the oil.

Source: H. E. Merritt, Hydraulic Control Systems (laminar leakage).
"""

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.valves.valve_kind import CircuitSite, ValveKind, ValvePlace


@kernel(inline="always")
def compute_bleed_flow(numbers: FloatArray, drop: float) -> tuple[float, float]:
    """Compute the flow Q = G Δp [m³/s] and its slope G; G is the valve's only number."""
    return numbers[0] * drop, numbers[0]


def _list_places(site: CircuitSite, section: None) -> list[ValvePlace]:
    """Return the bleed valve between rail and tank, as a list of one.

    Args:
        site: Circuit of a machine.
        section: Not used, since this kind has no section in the machine file.
    """
    return [ValvePlace(site.rail, site.tank, [float(site.constants["bleed_conductance"][0])])]


RAIL_BLEED = ValveKind(name="bleed", list_places=_list_places, compute_flow=compute_bleed_flow)
"""Bleed valve of the rail, which every circuit has."""
