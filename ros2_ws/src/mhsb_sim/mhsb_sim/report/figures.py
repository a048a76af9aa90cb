"""The figures of a report, one PNG file each."""

from __future__ import annotations

from pathlib import Path

from tqdm import tqdm

from mhsb_planner.evaluation.move_page import draw_move_page
from mhsb_planner.evaluation.operating_regions import OperatingRegions
from mhsb_sim.report.estimate_figure import draw_estimates
from mhsb_sim.report.hydraulic_figures import draw_energy, draw_modes, draw_pressures
from mhsb_sim.report.motion_figures import draw_joints, draw_tip_error
from mhsb_sim.report.recorded_moves import recorded_moves
from mhsb_sim.report.recorded_run import RecordedRun
from mhsb_sim.report.workspace_figure import draw_workspace

FIGURES = {
    "joints.png": draw_joints,
    "modes.png": draw_modes,
    "pressures.png": draw_pressures,
    "energy.png": draw_energy,
    "tip_error.png": draw_tip_error,
}
LEARNT_FIGURE = "estimates.png"
WORKSPACE_FIGURE = "workspace.png"


def draw_all(run: RecordedRun, regions: OperatingRegions, folder: Path) -> list[Path]:
    """Draw every figure of a run into a folder that is there; returns the files.

    What was learnt is drawn where the servo has told it.
    """
    figures = dict(FIGURES)
    if run.recording.estimates:
        figures[LEARNT_FIGURE] = draw_estimates
    with tqdm(total=1 + len(figures), desc="figures", leave=False, disable=None) as bar:
        draw_workspace(run, regions, folder / WORKSPACE_FIGURE)
        bar.update()
        for name, draw in figures.items():
            draw(run, folder / name)
            bar.update()
    return [folder / name for name in (WORKSPACE_FIGURE, *figures)]


def draw_moves(run: RecordedRun, folder: Path) -> list[Path]:
    """Draw a page for each move of a run; returns the files, numbered like the goals."""
    moves = recorded_moves(run)
    files = [folder / f"move_{number}.png" for number in range(1, len(moves) + 1)]
    pages = zip(moves, files, strict=True)
    for move, file in tqdm(pages, total=len(moves), desc="moves", leave=False, disable=None):
        draw_move_page(move, file)
    return files
