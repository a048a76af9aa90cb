"""The page of a move is drawn, and its regions end where valve and pumps do."""

from dataclasses import replace
from io import BytesIO
from itertools import combinations

import matplotlib.image
import matplotlib.pyplot
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mhsb_model.figure_style import (
    DOTS_PER_INCH,
    JOINT_COLORS,
    MODE_COLOR,
    PATH_COLOR,
    FigureFormatError,
)
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.modes import Mode
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner import Planner
from mhsb_tools import plot_plan
from mhsb_tools.moves import move_page
from mhsb_tools.moves.move import MoveRecord
from mhsb_tools.moves.move_page import compute_mode_limits, yield_mode_spans
from mhsb_tools.moves.workspace_drawing import SET_COLORS, draw_obstacles


@pytest.fixture(scope="module")
def move(machine):
    """Joint 1 goes up and stands, a third of the time in each mode."""
    time = np.linspace(0.0, 3.0, 91)
    position = np.tile(machine.config.simulation.start_posture, (91, 1))
    position[:, 0] += 0.1 * np.minimum(time, 2.0)
    modes = np.zeros((91, 3), dtype=np.uint8)
    modes[30:60, 0], modes[60:, 1] = Mode.DB, Mode.SB
    pressure = np.full((91, 3), 4e6)
    return MoveRecord(
        machine, "A move", ((0.5, 0.2),), time, position, position, modes,
        np.full((91, 3), 0.005), np.full((91, 3), 900.0), pressure, {"cap side": pressure / 2},
        {"main pump": -90.0, "throttling": 60.0, "leakage": 30.0}, "a test",
    )  # fmt: skip


def test_the_page_is_drawn_in_the_colours_of_the_modes(move, tmp_path):
    move_page.draw_move_page(move, tmp_path / "page.png")
    assert [file.name for file in tmp_path.iterdir()] == ["page.png"]
    picture = (255 * matplotlib.image.imread(tmp_path / "page.png")[..., :3]).round().astype(int)
    width = move_page.LEFT_WIDTH + 3 * move_page.COLUMN_WIDTH
    assert picture.shape[1] == round(width * DOTS_PER_INCH)
    for color in move_page.MODE_COLOR.values():
        wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
        assert np.sum(np.all(picture == wanted, axis=2)) > 500


@pytest.fixture(scope="module")
def plan(machine, table):
    start = MotionState.at_rest(machine.config.simulation.start_posture)
    return Planner(machine, table).plan((0.55, 0.60), start)


def test_a_plan_is_drawn_without_further_inputs(plan, tmp_path):
    plot_plan(plan, str(tmp_path / "plan.png"))
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    plot_plan(plan, tmp_path / "plan.PDF")
    assert (tmp_path / "plan.PDF").read_bytes().startswith(b"%PDF")
    for name in ("plan.docx", "plan"):
        with pytest.raises(
            FigureFormatError, match=rf"{name}': must end in one of .*\.pdf, .*\.png"
        ):
            plot_plan(plan, tmp_path / name)
        assert not (tmp_path / name).exists()


def test_a_plan_is_drawn_for_a_notebook_without_a_file_and_without_pyplot(
    plan, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    figure = plot_plan(plan, title="A plan")
    assert isinstance(figure, Figure)
    assert figure.get_suptitle().startswith("A plan: ")
    shown = matplotlib.image.imread(BytesIO(figure._repr_png_()))  # what IPython calls
    assert shown.shape[:2] == tuple((figure.get_size_inches() * figure.dpi).astype(int)[::-1])
    assert shown.std() > 0.05
    assert not matplotlib.pyplot.get_fignums()
    assert list(tmp_path.iterdir()) == []
    assert isinstance(plot_plan(plan, "plan.png"), Figure)


def test_a_path_shows_all_boosted_modes_that_are_in_force_at_a_time():
    modes = np.array([[0, 0], [1, 0], [1, 2], [0, 2], [0, 0], [0, 0]], dtype=np.uint8)
    assert list(move_page.yield_path_spans(modes)) == [
        (0, 1, Mode.N),
        (4, 5, Mode.N),
        (2, 4, Mode.SB),
        (1, 3, Mode.DB),
    ]
    axes = Figure().subplots()
    move_page.draw_tip_path(np.arange(12.0).reshape(6, 2), modes, axes)
    wide, narrow = axes.lines[2:4]
    assert (wide.get_color(), narrow.get_color()) == (PATH_COLOR[Mode.SB], PATH_COLOR[Mode.DB])
    assert wide.get_linewidth() > 2.0 * narrow.get_linewidth()
    labels = [line.get_label() for line in axes.lines[4:]]
    assert labels == ["tip, all actuators in N", "tip, an actuator in DB", "tip, an actuator in SB"]


def test_a_supply_line_stays_visible_where_another_pressure_equals_it(move):
    panels = Figure().subplots(1, 3)
    move_page._draw_pressures(replace(move, chambers={"needed": move.supply}), panels)
    supply, needed = panels[0].lines[:2]
    assert (supply.get_label(), needed.get_label()) == ("supply line", "needed")
    assert supply.get_zorder() <= needed.get_zorder()
    assert supply.get_linewidth() >= 2.0 * needed.get_linewidth()


def test_regions_have_a_legend_and_nothing_else_has_the_colours_of_boosted_modes(move):
    figure = Figure()
    panels = figure.subplots(1, 3)
    move_page._draw_regions(move, panels)
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words == [
        f"{words}{mode}{more}"
        for mode in ("N", "DB", "SB")
        for words, more in (("", " is enough"), ("the move, in ", ""))
    ]
    lines = [each.get_color() for each in legend.get_lines()]
    assert lines == list(PATH_COLOR.values())
    boosted = {colors[mode] for colors in (MODE_COLOR, PATH_COLOR) for mode in (Mode.DB, Mode.SB)}
    others = {*JOINT_COLORS, *move_page.ITEM_COLORS.values(), *SET_COLORS.values()}
    assert not boosted & others


def test_a_machine_without_boosters_has_no_other_modes_on_its_page(move):
    alone = replace(
        move, machine=move.machine.changed(module_count=0), modes=np.zeros_like(move.modes)
    )
    figure = Figure()
    *regions, bars = figure.subplots(1, 4)
    move_page._draw_regions(alone, np.array(regions))
    move_page.draw_mode_bars(alone, bars)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["N is enough", "the move, in N"]
    assert bars.get_legend_handles_labels()[1] == ["N"]


def test_spans_cover_all_instants_once():
    mode = np.array([0, 0, 1, 1, 1, 0, 2], dtype=np.uint8)
    assert list(yield_mode_spans(mode)) == [(0, 2, Mode.N), (2, 5, Mode.DB), (5, 6, Mode.N)]


def test_servo_pumps_bound_the_speed_of_boosted_modes(machine):
    m = machine.arrays
    for mode, pumps in ((Mode.DB, 1), (Mode.SB, 2)):
        slow, fast = compute_mode_limits(machine, 0, mode, np.array([1000.0]))
        assert fast[0] == pytest.approx(pumps * m.servo_pump_flow / m.cap_area[0])
        assert slow[0] == pytest.approx(-pumps * m.servo_pump_flow / m.rod_area[0])


def test_the_valve_bounds_normal_mode_and_pressure_its_force(machine):
    m = machine.arrays
    areas = m.cap_area[0] ** 3 + m.rod_area[0] ** 3
    force = 1200.0
    drive = m.cap_area[0] * (m.supply_pressure - m.boost_margin) - m.rod_area[0] * m.tank_pressure
    _, fast = compute_mode_limits(machine, 0, Mode.N, np.array([force, 4000.0]))
    assert fast[0] == pytest.approx(m.valve_coefficient[0] * np.sqrt((drive - force) / areas))
    assert fast[1] == 0.0  # more than P_S carries


def test_an_own_valve_bounds_its_actuator_alone(machine):
    own = machine.with_values({"joints.0.actuator.rated_flow": 2e-5})
    share = 2e-5 / machine.config.hydraulics.valve.rated_flow
    at, n = np.array([-500.0, 0.0, 800.0]), Mode.N
    np.testing.assert_allclose(
        compute_mode_limits(own, 0, n, at),
        share * np.array(compute_mode_limits(machine, 0, n, at)),
        rtol=1e-12,
    )
    np.testing.assert_array_equal(
        compute_mode_limits(own, 1, n, at), compute_mode_limits(machine, 1, n, at)
    )


def test_bands_are_as_high_as_their_share_and_small_ones_are_left_out():
    axes = Figure().subplots()
    energy = {"main pump": -80.0, "work on the loads": -20.0, "throttling": 75.0, "leakage": 24.9}
    move_page.draw_energy_flow(energy | {"friction": 0.1}, axes)
    heights = [patch.get_height() for patch in axes.patches]
    shares = np.array(heights) / heights[0]
    np.testing.assert_allclose(shares, np.array([80.0, 20.0, 75.0, 24.9]) / 80.0)
    words = [text.get_text() for text in axes.texts]
    assert words[0] == "main pump\n80 J, 80 %"
    assert words[1] == "given by sinking loads\n20 J, 20 %"
    assert not any("work on the loads" in each for each in words)
    assert not any("friction" in each for each in words)


@pytest.mark.parametrize(
    "shares",
    [
        [0.6, 0.37, 0.01, 0.01, 0.01],
        [0.005, 0.005, 0.005, 0.98, 0.005],
        [0.97, 0.005, 0.005, 0.005, 0.005, 0.005, 0.005],
        [1.0],
        [1 / 12] * 12,
    ],
)
def test_labels_of_thin_bands_keep_apart_and_within_the_picture(shares):
    middles = np.cumsum(shares) - np.array(shares) / 2
    places = move_page.label_places(middles)
    pitch = min(move_page.LEAST_PITCH, 1.0 / len(shares))
    assert np.all(np.diff(places) >= pitch - 1e-12)
    assert places[0] >= pitch / 2 - 1e-12
    assert places[-1] <= 1.0 - pitch / 2 + 1e-12


def test_labels_that_have_room_stand_at_the_middle_of_their_bands():
    middles = np.array([0.2, 0.5, 0.8])
    assert move_page.label_places(middles).tolist() == pytest.approx(middles.tolist())


def test_labels_as_drawn_do_not_overlap():
    figure = Figure((5.0, 2.6))
    axes = figure.subplots()
    energy = {"main pump": -506.0, "servo pumps": -11.0, "throttling": 214.0, "leakage": 275.0}
    energy |= {"oil to the tank": 13.0, "servo pump losses": 5.0, "friction": 8.0}
    move_page.draw_energy_flow(energy, axes)
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [text.get_window_extent(renderer) for text in axes.texts]
    assert len(boxes) == 7
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_joints_beyond_the_workspace_are_within_the_picture(move):
    axes = Figure().subplots()
    back = move.position + [np.pi / 2 + 0.5, 0.0, 0.0]
    move_page._draw_path(replace(move, position=back), axes)
    elbow = move.machine.joint_positions(back[0])[1]
    assert elbow[0] < -0.1
    assert axes.get_xlim()[0] < elbow[0]


def test_every_goal_is_drawn_at_its_place_with_its_number(move):
    figure = Figure()
    axes = figure.subplots()
    places = ((0.5, 0.2), (0.6, -0.3), (0.5, 0.2))
    move_page._draw_path(replace(move, goals=places), axes)
    circles = [line.get_xydata()[0].tolist() for line in axes.lines if line.get_markersize() == 9]
    assert circles[:2] == [[0.5, 0.2], [0.6, -0.3]]
    assert [(text.get_text(), text.xy) for text in axes.texts] == [
        ("1, 3", (0.5, 0.2)),
        ("2", (0.6, -0.3)),
    ]


def test_without_energy_the_diagram_says_so():
    axes = Figure().subplots()
    move_page.draw_energy_flow({"main pump": 0.0}, axes)
    assert [text.get_text() for text in axes.texts] == ["no energy"]


def test_zones_are_drawn_where_they_are_once_each(machine):
    axes = Figure().subplots()
    with_zones = machine.changed(
        zones=Zones(boxes=((0.6, 0.1, 0.9, 0.3),), tip_circles=((0.4, -0.5, 0.1),))
    )
    draw_obstacles(with_zones, axes, np.zeros((1, 3)))
    box, circle = axes.patches
    assert (*box.get_xy(), box.get_width(), box.get_height()) == pytest.approx((0.6, 0.1, 0.3, 0.2))
    assert (*circle.center, circle.radius) == pytest.approx((0.4, -0.5, 0.1))
    assert [box.get_label(), circle.get_label()] == ["keep-out", "keep-out of the tip"]


def test_zones_in_space_are_outlined_where_the_turning_plane_meets_them():
    excavator = load_machine(find_config_file("excavator.yaml"))
    zones = Zones(
        cylinders=((0.0, 2.0, -0.5, 1.0, 0.3), (2.0, -2.0, 0.0, 1.0, 0.2)),  # left, right
        tip_spheres=((1.5, 1.5, 0.5, 0.2),),
    )
    axes = Figure().subplots()
    turned = np.zeros((20, 4))
    turned[:, 0] = np.linspace(0.0, 1.5, 20)  # to the left, and not quite to the first one's axis
    draw_obstacles(excavator.changed(zones=zones), axes, turned)
    pole, ball = axes.patches
    # By points of the zones in planes that the arm is in, from joint 2, which is 0.5 m ahead.
    slew, ahead = np.meshgrid(np.linspace(0.0, 1.5, 2001), np.linspace(0.0, 4.0, 2001))
    x, y = ahead * np.cos(slew), ahead * np.sin(slew)
    met = ahead[np.hypot(x, y - 2.0) < 0.3] - 0.5
    left, low = pole.get_xy()
    assert (left, left + pole.get_width()) == pytest.approx((met.min(), met.max()), abs=5e-3)
    assert (low, low + pole.get_height()) == pytest.approx((-0.5, 1.0))
    assert ball.center == pytest.approx((np.hypot(1.5, 1.5) - 0.5, 0.5))
    assert not pole.get_fill()
    assert pole.get_alpha() > ball.get_alpha()
    labels = [pole.get_label(), ball.get_label()]
    assert labels == ["keep-out at some angle of the slew", "the tip's at some angle of the slew"]
