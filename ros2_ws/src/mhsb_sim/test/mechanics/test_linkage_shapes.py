import mujoco
import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_sim.mechanics import linkage_shapes
from mhsb_sim.mechanics.linkage_shapes import compute_planar_bars
from mhsb_sim.mechanics.mujoco_model import build_model


def drawn(machine: Machine, share: float) -> tuple[np.ndarray, list[linkage_shapes.Bar]]:
    """A posture at that share of all joints' ranges, and what is drawn of its linkages."""
    lower, upper = machine.arrays.joint_min, machine.arrays.joint_max
    q = lower + share * (upper - lower)
    return q, compute_planar_bars(machine, q)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_bars_end_in_the_pins_that_mujoco_moves(four_bar_machine: Machine, share: float) -> None:
    q, bars = drawn(four_bar_machine, share)
    model = build_model(four_bar_machine)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    for j, name in enumerate(four_bar_machine.actuator_names):
        rocker, coupler, _, barrel = bars[4 * j : 4 * j + 4]
        for pin, place in (
            ("rocker_pivot", rocker.start), ("child_pin", coupler.end), ("parent_pin", barrel.start)
        ):  # fmt: skip
            np.testing.assert_allclose(place, data.site(f"{name}_{pin}").xpos, atol=1e-12)


def test_a_telescopes_cylinder_is_drawn_along_its_boom_to_its_tip() -> None:
    machine = load_machine(find_config_file("telescope_arm.yaml"))
    pins = []
    for share in (0.0, 0.7):
        q, bars = drawn(machine, share)
        rod, barrel = bars[-2:]
        np.testing.assert_allclose(rod.end[[0, 2]], machine.tip_position(q), atol=1e-12)
        length = np.linalg.norm(rod.end - rod.start)
        assert length == pytest.approx(machine.cylinder_lengths(q)[2])
        elbow = machine.joint_positions(q)[1]
        pins.append(np.linalg.norm(barrel.start[[0, 2]] - elbow))  # fixed in the boom
    assert pins[0] == pytest.approx(pins[1])


def lengths(bars: list[linkage_shapes.Bar], paint: tuple[float, ...]) -> list[float]:
    return [float(np.linalg.norm(bar.end - bar.start)) for bar in bars if bar.color == paint]


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_rockers_couplers_and_rods_are_drawn_as_long_as_they_are(
    four_bar_machine: Machine, share: float
) -> None:
    q, bars = drawn(four_bar_machine, share)
    four_bars = [joint.linkage for joint in four_bar_machine.config.joints]
    rockers = lengths(bars, linkage_shapes.ROCKER_PAINT)
    couplers = lengths(bars, linkage_shapes.COUPLER_PAINT)
    np.testing.assert_allclose(rockers, [each.rocker_length for each in four_bars])
    np.testing.assert_allclose(couplers, [each.coupler_length for each in four_bars])
    rods = lengths(bars, linkage_shapes.ROD_PAINT)
    np.testing.assert_allclose(rods, four_bar_machine.cylinder_lengths(q))


def test_a_slider_crank_is_drawn_as_a_rod_and_a_barrel_shorter_than_it(
    slider_crank_machine: Machine,
) -> None:
    q, bars = drawn(slider_crank_machine, 0.0)
    assert len(bars) == 2 * slider_crank_machine.joint_count
    rods = lengths(bars, linkage_shapes.ROD_PAINT)
    np.testing.assert_allclose(rods, slider_crank_machine.cylinder_lengths(q))
    assert np.all(np.array(lengths(bars, linkage_shapes.BARREL_PAINT)) < rods)
