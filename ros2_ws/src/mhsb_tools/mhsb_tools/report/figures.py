"""Figures of a report, one PNG file each."""

from __future__ import annotations

from pathlib import Path

from tqdm import tqdm

from mhsb_tools.moves.move_page import draw_move_page
from mhsb_tools.moves.operating_regions import OperatingRegions
from mhsb_tools.report.recorded_moves import cut_into_moves
from mhsb_tools.report.recorded_run import EvaluatedRecording
from mhsb_tools.report.time_figures import (
    draw_energy,
    draw_estimates,
    draw_joints,
    draw_modes,
    draw_pressures,
    draw_tip_error,
)
from mhsb_tools.report.workspace_figure import draw_workspace

FIGURE_FILES = {
    "joints.png": draw_joints,
    "modes.png": draw_modes,
    "pressures.png": draw_pressures,
    "energy.png": draw_energy,
    "tip_error.png": draw_tip_error,
}
"""Function that draws each figure, by its file name; the estimates' and the workspace's come on
top.
"""

LEARNT_FIGURE = "estimates.png"
WORKSPACE_FIGURE = "workspace.png"


def draw_all(run: EvaluatedRecording, regions: OperatingRegions, folder: Path) -> list[Path]:
    """Draw all figures of a recording and write them into a folder.

    The figure of estimates is drawn only if the recording has estimates. A progress bar is shown on
    a terminal.

    Args:
        run: The evaluated recording.
        regions: Nodes of the workspace at which joints need boost.
        folder: Existing folder.

    Returns:
        The written PNG files.
    """
    figures = dict(FIGURE_FILES)
    if run.recording.estimates:
        figures[LEARNT_FIGURE] = draw_estimates
    with tqdm(total=1 + len(figures), desc="figures", leave=False, disable=None) as bar:
        draw_workspace(run, regions, folder / WORKSPACE_FIGURE)
        bar.update()
        for name, draw in figures.items():
            draw(run, folder / name)
            bar.update()
    return [folder / name for name in (WORKSPACE_FIGURE, *figures)]


def draw_moves(run: EvaluatedRecording, folder: Path) -> list[Path]:
    """Draw a page for each move of a recording and write it into a folder.

    A move begins when a goal's plan takes over. It ends when the next plan takes over or shortly
    after the arm has come to rest.

    Args:
        run: The evaluated recording.
        folder: Existing folder.

    Returns:
        The written files `move_1.png`, `move_2.png` and so on, in time order. The numbers are those
        of the pages; goals without a page have no number.
    """
    moves = cut_into_moves(run)
    files = [folder / f"move_{number}.png" for number in range(1, len(moves) + 1)]
    pages = zip(moves, files, strict=True)
    for move, file in tqdm(pages, total=len(moves), desc="moves", leave=False, disable=None):
        draw_move_page(move, file)
    return files
