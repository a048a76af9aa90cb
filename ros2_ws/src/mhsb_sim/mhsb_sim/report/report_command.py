"""`report`: figures and numbers of a recording."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from mhsb_model import command_line
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.evaluation.operating_regions import operating_regions
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_sim.recording.bag_reader import read_recording
from mhsb_sim.report import figures
from mhsb_sim.report.recorded_run import recorded_run
from mhsb_sim.report.summary import summary

SUMMARY_FILE = "summary.json"


def report(
    bag: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")],
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    table: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    namespace: str = "",
    moves: bool = False,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Draw figures (PNG) from a recording and sum it up in summary.json.

    Figures show joint angles in deg, pressures in MPa, energy in J, the tip's path in m and its
    error in mm, over time in s. Files of the same names in DIR are replaced.

    Args:
        bag: Folder of the recording (rosbag2).
        output: Folder for figures and summary; made where it is not there.
        machine: Machine file (YAML) of the recording; the suite's own arm when left out.
        table: Posture table (npz), for the regions where boost is needed; built and kept in the
            user's cache when left out.
        namespace: Namespace of the recorded topics, such as /left.
        moves: Also draw a page for each move: path, joints, modes, operating regions, pressures,
            energy.
        json_: Print the summary as one JSON object instead of text.
    """
    command_line.keep(f"{output} has no new {SUMMARY_FILE}, but may have new figures")
    content = write_report(bag, output, load_machine(machine), table, namespace, moves=moves)
    if json_:
        print(json.dumps(content))
        return
    print("\n".join(summary_lines(content)))
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
    """Write the figures and summary.json of a recording into a folder; returns the summary.

    Nothing is written where the recording cannot be used. Raises BagError, TableError, and
    MhsbError where the output is not a folder.
    """
    run = recorded_run(read_recording(bag, namespace, machine.slews), machine)
    regions = operating_regions(machine, table_for(machine, table))
    content = summary(run)
    make_output_folder(output, "the report")
    figures.draw_all(run, regions, output)
    if moves:
        figures.draw_moves(run, output)
    part = output / f"{SUMMARY_FILE}.part"
    part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(part, output / SUMMARY_FILE)
    return content


def summary_lines(content: dict[str, Any]) -> list[str]:
    """The summary for a person, one number a line; what is told of goals is left to the file."""
    numbers = {key: value for key, value in content.items() if key not in ("goals", "lost")}
    return [f"  {key}: {_text(value)}" for key, value in numbers.items()]


def _text(value: Any) -> str:
    """A value with four digits, None as a dash."""
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


def main() -> int:
    """Entry point of `ros2 run mhsb_sim report`."""
    return command_line.run(report, name="report")


if __name__ == "__main__":
    sys.exit(main())
