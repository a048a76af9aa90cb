"""Counts of grid points in the workspace: where loads are held at rest, where zones leave room."""

from typing import Any

import numpy as np

from mhsb_model.hydraulics import (
    compute_required_pressures,
    get_max_supply_pressure,
    get_shared_hydraulics,
)
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.posture.grid import list_grid_nodes
from mhsb_tools.moves.operating_regions import OperatingRegions

PSI_SAMPLES, TELESCOPE_PSI_SAMPLES = 180, 3600
"""Number of end-link angles ψ at which postures are looked for at each point.

The larger number is for arms with a telescope: their postures may exist within a few degrees of ψ
only.
"""

SLEW_SAMPLES = 72
"""Number of slew angles at which zones are tested; 5° apart if the arm turns all the way."""


def count_workspace_points(machine: Machine) -> dict[str, Any]:
    """Count the grid points of the workspace by the supply pressure that holds the arm there.

    The required pressure of a posture is the highest one that any of its actuators needs at rest.
    At each point, the posture with the lowest required pressure counts.

    Args:
        machine: The planar arm (without the slewing joint).

    Returns:
        A dictionary. Keys:

        - points: number of grid points
        - spacing_m: distance between neighbouring points
        - end_link_angles: number of angles ψ of the end link that are tried at each point
        - held: points where the supply pressure P_S suffices
        - boosted: points where some actuator needs boost
        - too_heavy: points that need more than the highest boost pressure, or more than P_S if
            there are no booster modules
        - no_posture: points without a posture within the joint limits
        - boosted_by_joint: list with the number of `boosted` points at which each joint needs boost

        `held`, `boosted`, `too_heavy` and `no_posture` add up to `points`.
    """
    regions = find_hold_regions(machine)
    points, reached = len(list_workspace_points(machine)), len(regions.nodes)
    too_heavy = int(regions.beyond_highest_boost.sum())
    needs_boost = int(regions.needs_boost.sum())
    return {
        "points": points,
        "spacing_m": machine.spacing,
        "end_link_angles": len(list_end_link_angles(machine)),
        "held": reached - needs_boost - too_heavy,
        "boosted": needs_boost,
        "too_heavy": too_heavy,
        "no_posture": points - reached,
        "boosted_by_joint": regions.boosted[regions.needs_boost].sum(axis=0).tolist(),
    }


def find_hold_regions(machine: Machine) -> OperatingRegions:
    """Find where the machine holds its load at rest, and which joints need boost for it.

    At each point of the workspace grid, the posture with the lowest required pressure counts.

    Args:
        machine: The arm. If it slews, the points are in the plane that joint 1 turns.

    Returns:
        The regions, with a column for each joint in the arm's plane. Without booster modules,
        `beyond_highest_boost` has all points at which a joint needs more than the supply pressure.
    """
    plane = machine.planar_arm
    m = plane.arrays
    highest = get_max_supply_pressure(get_shared_hydraulics(m), m.module_count)
    found = [
        (node, _find_lowest_hold_pressures(plane, *node)) for node in list_workspace_points(plane)
    ]
    reached = [(node, needed) for node, needed in found if needed is not None]
    needed = np.array([each for _, each in reached]).reshape(-1, plane.joint_count)
    nodes = np.array([node for node, _ in reached]).reshape(-1, 2) / plane.spacing
    return OperatingRegions(
        plane.spacing,
        np.rint(nodes).astype(np.int64),
        (needed > m.supply_pressure) & (m.module_count > 0),
        needed.max(axis=1, initial=0.0) > highest,
    )


def count_points_left(machine: Machine) -> dict[str, Any]:
    """Count the workspace points that the arm reaches, with and without its obstacles.

    A point is reached if it has a posture within the joint limits. It is left if one of these
    postures also keeps clear of all obstacles, margin included. An arm that slews may have zones in
    space. Each point is then tested at `SLEW_SAMPLES` slew angles, and each angle counts as one
    point.

    Args:
        machine: An arm that has obstacles.

    Returns:
        A dictionary. Keys:

        - margin_m: distance to keep from obstacles
        - obstacles: list of names
        - slew_angles: number of slew angles; missing if no zone is given in space
        - reached: count of points without regard to obstacles
        - left: count of points with a posture clear of obstacles
    """
    plane, in_space = machine.planar_arm, bool(machine.obstacles.is_in_space.any())
    psi, turned, m = list_end_link_angles(plane), np.zeros(1), machine.arrays
    if in_space:
        turned = np.linspace(m.joint_min[0], m.joint_max[0], SLEW_SAMPLES)
    near = [
        angle
        for angle in turned
        if len(machine.make_planar_arm_with_shadows(angle, angle).shadows.rows)
    ]
    reached = left = 0
    for x, z in list_workspace_points(plane):
        postures = plane.postures(x, z, psi)
        if len(postures) == 0:
            continue
        reached += len(turned)
        distance, _ = clearances(plane.arrays, plane.obstacles.path_rows, postures)
        clear = frozen(postures[distance >= 0.0])
        if len(clear) > 0:
            left += len(turned) - len(near)
            left += sum(_is_clear_of_zones(machine, angle, clear) for angle in near)
    return {
        "margin_m": float(machine.config.keep_out.margin),
        "obstacles": list(machine.obstacles.names),
        **({"slew_angles": len(turned)} if in_space else {}),
        "reached": reached,
        "left": left,
    }


def _is_clear_of_zones(machine: Machine, slew: float, postures: FloatArray) -> bool:
    """Return whether at least one posture keeps clear of the zones in space.

    Zones in space are those that are given by x, y and z.

    Args:
        machine: An arm that slews.
        slew: Slew angle for all postures [rad].
        postures: Joint positions without joint 1, shape (k, n − 1) [rad or m], k ≥ 1.

    Returns:
        True if at least one of the k postures keeps the margin from all zones in space.
    """
    zones = frozen(machine.obstacles.path_rows[machine.obstacles.is_in_space])
    turned = frozen(np.column_stack([np.full(len(postures), slew), postures]))
    return bool(clearances(machine.arrays, zones, turned)[0].max() >= 0.0)


def list_end_link_angles(machine: Machine) -> FloatArray:
    """Return the end-link angles ψ [rad] at which postures are looked for at each point."""
    count = TELESCOPE_PSI_SAMPLES if machine.has_telescope else PSI_SAMPLES
    return np.linspace(-np.pi, np.pi, count, endpoint=False)


def list_workspace_points(machine: Machine) -> list[tuple[float, float]]:
    """List the grid points of the workspace.

    Args:
        machine: The planar arm (without the slewing joint).

    Returns:
        Points (x, z) [m] at integer multiples of the machine's grid spacing. They lie between the
        workspace's smallest and largest radius, and not below its smallest x.
    """
    nodes = list_grid_nodes(machine, machine.spacing) * machine.spacing
    return [(x, z) for x, z in nodes.tolist()]


def _find_lowest_hold_pressures(machine: Machine, x: float, z: float) -> FloatArray | None:
    """Return the supply pressures that hold the arm, at rest with the tip at a given point.

    Postures with all sampled angles of the end link are tried. For each, the highest pressure that
    any of its actuators requires counts. The posture for which this is lowest is taken.

    Args:
        machine: The planar arm (without the slewing joint).
        x: Tip position forward [m].
        z: Tip position up [m].

    Returns:
        Required supply pressure of each actuator at rest, boost margin included [Pa], shape (n,).
        None if the point has no posture within the joint limits.
    """
    psi = list_end_link_angles(machine)
    postures = machine.postures(x, z, psi)
    if len(postures) == 0:
        return None
    force = machine.piston_forces_in(postures)
    needed = compute_required_pressures(machine.arrays, force, np.zeros(force.shape))
    return np.array(needed[np.argmin(needed.max(axis=1))])
