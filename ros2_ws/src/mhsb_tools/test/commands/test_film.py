"""A film shows the arm move, in the colours of its modes, at the pace that was asked for."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageSequence

from mhsb_model.errors import ArgumentError
from mhsb_model.figure_style import MODE_COLOR
from mhsb_model.modes import Mode
from mhsb_sim.mechanics.linkage_shapes import BARREL_PAINT, compute_planar_bars
from mhsb_tools.commands.film import BARREL_WIDTH, FIGURE_SIZE, FilmGoal, _Film, write_film
from mhsb_tools.moves.move import MoveRecord

WIDTH = 480


@pytest.fixture(scope="module")
def move(machine):
    """Joint 1 goes up for two seconds, actuator 1 in N, DB and SB one after the other."""
    time = np.linspace(5.0, 7.0, 61)
    position = np.tile(machine.config.simulation.start_posture, (61, 1))
    position[:, 0] += 0.3 * (time - 5.0)
    modes = np.zeros((61, 3), dtype=np.uint8)
    modes[20:40, 0], modes[40:, 0] = Mode.DB, Mode.SB
    flat, goal = np.zeros((61, 3)), (0.5, 0.2)
    return MoveRecord(
        machine, "A move", (goal,), time, position, None, modes, flat, flat, flat + 4e6, {}, {}, ""
    )  # fmt: skip


@pytest.fixture(scope="module")
def frames(move, tmp_path_factory):
    file = tmp_path_factory.mktemp("film") / "move.gif"
    count = write_film(move, [FilmGoal(5.5, (0.5, 0.2))], file, speed=0.5, rate=10, width=WIDTH)
    assert [each.name for each in file.parent.iterdir()] == ["move.gif"]
    with Image.open(file) as film:
        assert film.info["duration"] == 100  # ms
        pictures = [np.array(each.convert("RGB")) for each in ImageSequence.Iterator(film)]
    assert len(pictures) == count
    return pictures


def test_it_lasts_as_long_as_its_speed_says(frames):
    assert len(frames) == 41  # 2 s at half the speed, ten pictures a second, the end included
    assert frames[0].shape[1] == WIDTH


def test_the_arm_moves_and_the_axes_stand_still(frames):
    pairs = zip(frames[:-5], frames[5:], strict=True)
    moved = [np.mean(np.any(one != other, axis=2)) for one, other in pairs]
    assert min(moved) > 0.002
    assert max(moved) < 0.1


def test_the_barrel_takes_the_colour_of_its_mode(frames):
    left = slice(0, WIDTH * 4 // 10)  # the stage; modes and pressures are on the right
    for row, mode in ((5, Mode.N), (20, Mode.DB), (36, Mode.SB)):
        for each, color in MODE_COLOR.items():
            wanted = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
            near = np.all(np.abs(frames[row][:, left].astype(int) - wanted) < 12, axis=2).sum()
            if each is not Mode.N:  # the other two actuators are in N all the time
                assert bool(near > 60) is (each is mode), (row, each, near)


def test_a_goal_is_shown_from_its_time_on(frames):
    def dark(picture):
        return int((picture[:, : WIDTH // 2].max(axis=2) < 60).sum())

    before = max(map(dark, frames[4:10]))
    assert min(map(dark, frames[10:16])) > before + 8


def test_cylinders_lie_within_the_stage_with_all_of_their_width(machine, move, tmp_path):
    position = np.tile(machine.config.simulation.start_posture, (61, 1))
    position[:, 0] = np.linspace(machine.arrays.joint_min[0], machine.arrays.joint_max[0], 61)
    film = _Film(replace(move, position=position), [], WIDTH)
    per_metre = np.diff(film._stage.transData.transform([[0, 0], [1, 1]]), axis=0).min()
    half = (BARREL_WIDTH + 2.0) / 2 * (WIDTH / FIGURE_SIZE[0]) / 72 / per_metre  # m
    for q in position:
        bars = [bar for bar in compute_planar_bars(machine, q) if bar.color == BARREL_PAINT]
        ends = np.array([end[[0, 2]] for bar in bars for end in (bar.start, bar.end)])
        for low, high, values in zip(
            (film._stage.get_xlim()[0], film._stage.get_ylim()[0]),
            (film._stage.get_xlim()[1], film._stage.get_ylim()[1]),
            ends.T,
            strict=True,
        ):
            assert low <= values.min() - half
            assert values.max() + half <= high


def test_a_film_of_years_is_refused_before_anything_is_drawn(move, tmp_path):
    years = replace(move, time=np.linspace(0.0, 2e9, 61))
    with pytest.raises(ArgumentError, match=r"would have \d+ pictures .* at most 5000 are made"):
        write_film(years, [], tmp_path / "move.gif")
    assert list(tmp_path.iterdir()) == []
