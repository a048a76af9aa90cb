"""Command `report`: figures and numbers of a recording."""

import json
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, OptionalFile
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_tools.moves.move_page import draw_move_page
from mhsb_tools.moves.operating_regions import OperatingRegions, determine_operating_regions
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.report.recorded_moves import cut_into_moves
from mhsb_tools.report.recorded_run import EvaluatedRecording, evaluate_recording
from mhsb_tools.report.summary import compute_summary
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


def draw_all(run: EvaluatedRecording, regions: OperatingRegions, folder: Path) -> None:
    """Draw all figures of a recording and write them into a folder.

    The figure of estimates is drawn only if the recording has estimates. A progress bar is shown on
    a terminal.

    Args:
        run: The evaluated recording.
        regions: Nodes of the workspace at which joints need boost.
        folder: Existing folder.
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


def draw_moves(run: EvaluatedRecording, folder: Path) -> None:
    """Draw a page for each move of a recording and write it into a folder.

    A move begins when a goal's plan takes over. It ends when the next plan takes over or shortly
    after the arm has come to rest. The pages are `move_1.png`, `move_2.png` and so on, in time
    order; goals without a page have no number.

    Args:
        run: The evaluated recording.
        folder: Existing folder.
    """
    bar = tqdm(cut_into_moves(run), desc="moves", leave=False, disable=None)
    for number, move in enumerate(bar, start=1):
        draw_move_page(move, folder / f"move_{number}.png")


SUMMARY_FILE = "summary.json"


def report(
    bag: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")],
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    machine: OptionalFile = None,
    table: OptionalFile = None,
    namespace: str = "",
    moves: bool = False,
    json_: JsonFlag = False,
) -> None:
    """Draw figures (PNG) of a recording and write its numbers into summary.json.

    Figures show joint angles in deg, pressures in MPa, energy in J, the tip's path in m and its
    error in mm, over time in s. Files of the same names in DIR are replaced. In summary.json,
    energy_measured_j is the energy to the oil by main pump (mp) and servo pumps (sp).

    Args:
        bag: Folder of the recording (rosbag2).
        output: Folder for figures and summary; made if it is missing.
        machine: Machine file (YAML) of the recording; the suite's own arm if omitted.
        table: Posture table (npz), for the regions where boost is needed; built and kept in the
            user's cache if omitted.
        namespace: Namespace of the recorded topics, such as /left; none when left out.
        moves: Also draw a page for each move: path, joints, modes, operating regions, pressures,
            energy.
        json_: Print the summary as one JSON object instead of text.

    Raises:
        BagError: The recording cannot be used.
        TableError: The posture table cannot be used.
        MhsbError: The machine file cannot be used, or `output` is not a folder.
    """
    command_line.set_interrupt_note(f"{output} has no new {SUMMARY_FILE}, but may have new figures")
    content = write_report(bag, output, load_machine(machine), table, namespace, moves=moves)
    if json_:
        print(json.dumps(content))
        return
    print("\n".join(format_summary(content)))
    print(f"written to {output}")


def write_report(
    bag: Path,
    output: Path,
    machine: Machine,
    table: Path | None = None,
    namespace: str = "",
    *,
    moves: bool = False,
) -> dict[str, Any]:
    """Write the figures and the summary of a recording into a folder.

    The recording is evaluated completely before anything is written. The summary is written last
    and never incomplete. The posture table is built if it is not cached.

    Args:
        bag: Folder of the recording (rosbag2).
        output: Folder for the results; created if it does not exist. Files of the same names are
            replaced.
        machine: Machine of the recording.
        table: Posture table file, for the regions where boost is needed; None takes it from the
            cache or builds it.
        namespace: Namespace of the recorded topics, such as `/left`; empty for none.
        moves: Whether to draw also a page for each move.

    Returns:
        The summary, as written to summary.json.

    Raises:
        BagError: The recording cannot be used.
        TableError: The posture table cannot be used.
        MhsbError: `output` is not a folder.
    """
    run = evaluate_recording(read_recording(bag, namespace, machine.slews), machine)
    regions = determine_operating_regions(machine, load_or_build_table(machine, table))
    content = compute_summary(run)
    make_output_folder(output, "the report")
    draw_all(run, regions, output)
    if moves:
        draw_moves(run, output)
    write_json(output / SUMMARY_FILE, content)
    return content


def format_summary(content: dict[str, Any]) -> list[str]:
    """Format the summary for a person.

    Args:
        content: The summary.

    Returns:
        A line `key: value` for each entry, without the lists `goals` and `lost`.
    """
    numbers = {key: value for key, value in content.items() if key not in ("goals", "lost")}
    return [f"  {key}: {_text(value)}" for key, value in numbers.items()]


def _text(value: Any) -> str:
    """Format a value of the summary as text.

    Args:
        value: Number, text, None, or a list or dictionary of such values.

    Returns:
        One line. Floats have four significant digits, None is a dash. Elements of lists and
        dictionaries are separated by commas. In a dictionary, each value has its key before it.
    """
    match value:
        case None:
            return "–"
        case float():
            return f"{value:.4g}"
        case dict():
            return ", ".join(f"{key} {_text(each)}" for key, each in value.items())
        case list():
            return ", ".join(_text(each) for each in value)
        case _:
            return str(value)


main = command_line.make_main(report)
