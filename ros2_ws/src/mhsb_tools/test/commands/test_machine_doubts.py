"""Doubts about machine files that the schema allows."""

import math

import pytest

from mhsb_control import load_machine
from mhsb_tools.commands.machine_doubts import list_doubts

SHIPPED = ["mhsb_arm3", "mhsb_arm4", "excavator", "excavator_1to14", "forestry_crane"]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_machines_raise_no_doubt(name):
    assert list_doubts(load_machine(name), 100, 100) == []


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (
            {"circuit.line_relief_pressure": 1.25e6},
            "circuit.line_relief_pressure 1.25 MPa is below the main pump's 2.5 MPa, whose oil its "
            "valves let go; raise it above that pressure",
        ),
        (
            {"imperfections.computing_delay": 0.0805},
            "imperfections.computing_delay 80.5 ms is no whole number of steps of 1 ms; 80 ms are "
            "simulated, so give that",
        ),
        (
            {"imperfections.computing_delay": 0.08, "simulation.step": 3e-3},
            "imperfections.computing_delay 80 ms is no whole number of steps of 3 ms; 81 ms are "
            "simulated, so give that",
        ),
    ],
)
def test_a_doubt_names_value_limit_and_remedy(values, sentence):
    assert list_doubts(load_machine("excavator_1to14").with_values(values), 100, 100) == [sentence]


def test_lines_that_are_relieved_below_the_highest_boost_pressure_are_a_doubt(machine):
    low = machine.with_values({"circuit.line_relief_pressure": 9e6})
    assert list_doubts(low, 100, 100) == [
        "circuit.line_relief_pressure 9 MPa is below hydraulics.servo_pump.max_boost_pressure 10 "
        "MPa, which lines then never reach; raise it above that pressure"
    ]
    assert list_doubts(low.changed(module_count=0), 100, 100) == []


def pump_flow_needed(machine, speed):
    """Flow of the main pump [m³/s] that extends piston 1 at a speed [m/s], leakage included."""
    cylinder, valve = machine.config.joints[0].cylinder, machine.config.hydraulics.valve
    leakage = machine.joint_count * machine.arrays.leakage_flow
    assert leakage == machine.joint_count * valve.leakage_flow
    return math.pi / 4 * cylinder.bore**2 * speed + leakage


def rated_flow_needed(machine, speed):
    """Rated flow [m³/s] of a valve that moves piston 1 both ways at a speed [m/s], without a load.

    Force balance: inlet (p_S - c inlet² v²) = outlet (p_T + c outlet² v²), c from the rated flow.
    """
    cylinder, oil = machine.config.joints[0].cylinder, machine.config.hydraulics
    cap = math.pi / 4 * cylinder.bore**2
    rod = math.pi / 4 * (cylinder.bore**2 - cylinder.rod**2)
    least = min(
        (inlet * oil.main_pump.pressure - outlet * oil.tank_pressure) / (inlet**3 + outlet**3)
        for inlet, outlet in ((cap, rod), (rod, cap))
    )
    return math.sqrt(oil.valve.rated_pressure_drop_per_land / least) * speed


@pytest.mark.parametrize(
    ("key", "compute_needed"),
    [
        ("hydraulics.main_pump.max_flow", pump_flow_needed),
        ("hydraulics.valve.rated_flow", rated_flow_needed),
    ],
)
def test_a_flow_just_below_what_v_max_needs_is_a_doubt_with_both_values(
    machine, key, compute_needed
):
    speed = machine.config.motion.max_piston_speed
    needed = compute_needed(machine, speed)
    low = 0.99 * needed
    [doubt] = list_doubts(machine.with_values({key: low}), 100, 100)
    assert doubt.startswith("V_max is beyond what main pump and valves give without a load: ")
    for number in (1, 2, 3):
        wanted = f"actuator {number} needs {key} {needed:.4g} m³/s for {1e3 * speed:.4g} mm/s"
        assert f"{wanted}, not {low:.4g}; " in doubt
    assert doubt.endswith("; raise these flows, or lower motion.max_piston_speed")
    assert list_doubts(machine.with_values({key: float(f"{needed:.4g}")}), 100, 100) == []


def test_a_flow_that_is_too_low_for_one_actuator_is_named_by_its_own_key(machine):
    needed = rated_flow_needed(machine, machine.config.motion.max_piston_speed)
    slow = machine.with_values({"joints.0.actuator.rated_flow": 0.99 * needed})
    [doubt] = list_doubts(slow, 100, 100)
    assert f"actuator 1 needs joints.0.actuator.rated_flow {needed:.4g} m³/s" in doubt
    assert "actuator 2" not in doubt


def test_a_main_pump_that_is_far_too_large_is_asked_about_in_another_unit():
    arm = load_machine("excavator_1to14").with_values({"hydraulics.main_pump.max_flow": 0.0667})
    [doubt] = list_doubts(arm, 100, 100)
    assert "hydraulics.main_pump.max_flow 0.0667 m³/s is " in doubt
    assert "; in L/min? 0.0667 L/min are 1.112e-06 m³/s" in doubt


def test_a_pin_that_is_farther_away_than_the_links_are_long_is_asked_about_in_another_unit():
    excavator = load_machine("excavator")
    length = excavator.config.joints[1].link.length  # the boom's; the arm is shorter
    far = excavator.with_values({"joints.2.linkage.child_pin.radius": 2.01 * length})
    [doubt] = list_doubts(far, 100, 100)
    assert doubt.startswith(
        f"joints.2.linkage.child_pin.radius {2.01 * length:.5g} m is 2.01 times "
    )
    assert "; in cm or mm? " in doubt


def test_a_payload_that_is_held_nowhere_is_a_doubt():
    [doubt] = list_doubts(load_machine("excavator_1to14"), 0, 100)
    assert doubt.endswith("lower payload.mass, or raise pressures, bores or moment arms")


def test_an_arm_without_a_posture_anywhere_is_not_said_to_be_overloaded(machine):
    [doubt] = list_doubts(machine, 0, 0)
    assert "link lengths" in doubt
    assert "payload" not in doubt


def test_a_servo_pump_that_is_too_weak_for_its_flow_is_a_doubt(machine):
    pump = machine.config.hydraulics.servo_pump
    boost = pump.max_boost_pressure - machine.config.hydraulics.main_pump.pressure
    taken = boost * pump.max_flow / pump.efficiency
    weak = machine.with_values({"circuit.servo_pump_power": 0.9 * taken})
    [doubt] = list_doubts(weak, 100, 100)
    assert f"{0.9 * taken:g} W is below the {taken:.3g} W" in doubt
    assert list_doubts(machine.with_values({"circuit.servo_pump_power": taken}), 100, 100) == []
