"""`scripts/soak`: random goals, stops, kills and faults, and a check of every promise."""

from __future__ import annotations

import math
import os
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import tyro
from benchmarks.message_watcher import MessageWatcher
from benchmarks.seeded_goals import SeededGoal, draw_reachable_goals
from rclpy.executors import ExternalShutdownException
from tests.soak.actor import Actor, make_invalid_goal
from tests.soak.events import PLANNER, SIM, ActionKind, Events
from tests.soak.kept import PromiseResult
from tests.soak.promises import PROMISES
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, NumberRange, OptionalFile, Seed, UsageError
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import GoalVerdict
from mhsb_msgs_py.node_process import run_ros, serve_node
from mhsb_planner.planner import Planner, warm_up
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_tools.live.nodes import check_no_other_nodes
from mhsb_tools.study.headless import compile_kernels

GOALS = 100
"""Number of different goals, which are sent repeatedly."""
FAULTS = (
    "main_pump",
    "servo_pumps",
    "servo_pump_dead:2",
    "servo_pump_slow:1",
    "valve_stuck:actuator_2",
    "valve_hard_over:actuator_3",
    "sensor_dead:actuator_1.line_pressure",
    "sensor_frozen:actuator_2.cap_pressure",
)
"""Faults that are injected."""

MORTAL_SHARE = 1 / 3
"""Share of the time in which nodes are ended and started anew; the check of memory needs longer
lives.
"""

WAITS = (0.3, 3.0)
"""Range of the time between two actions [s]."""
LAST_WAIT = 40.0
"""Time at the end in which all executions end [s]."""

MEMORY_STRIDE = 60
"""Number of memory readings, a second apart, of which one is written."""

BROKEN_SHOWN = 5
"""Largest number of sentences printed for one promise."""

Choice = TypeVar("Choice")


@dataclass(frozen=True)
class ActionChoice:
    """Action that may be chosen next.

    Attributes:
        weight: Relative frequency.
        do: Function that acts.
        ends_node: Whether it ends a node.
    """

    weight: float
    do: Callable[[Soak], None]
    ends_node: bool = False


class Soak:
    """Chooses random actions on both nodes."""

    def __init__(self, actor: Actor, goals: list[SeededGoal], machine: Machine, seed: int) -> None:
        """Prepare the soak.

        Args:
            actor: Acts on the nodes.
            goals: Goals that can be reached.
            machine: The arm.
            seed: Seed of all random choices.
        """
        self.actor, self.goals, self.machine = actor, goals, machine
        self.random = np.random.default_rng(seed)

    def run(self, seconds: float) -> None:
        """Act at random for some time, then heal all faults and wait until all executions end.

        Nodes that do not run are started before each action. Nodes are ended only in the first
        `MORTAL_SHARE` of the time.

        Args:
            seconds: Duration without the final wait [s].
        """
        began, bar = time.monotonic(), tqdm(total=round(seconds), unit="s", disable=None)
        while (elapsed := time.monotonic() - began) < seconds:
            bar.update(round(elapsed) - bar.n)
            for node in self.actor.list_missing():
                self.actor.start(node)
            self._choose(mortal=elapsed < MORTAL_SHARE * seconds).do(self)
            self.actor.wait(self.random.uniform(*WAITS))
        bar.close()
        self.heal()
        self.actor.wait(LAST_WAIT)

    def _choose(self, mortal: bool) -> ActionChoice:
        """Draw one of `ACTIONS` by their weights.

        Args:
            mortal: Whether actions that end a node are allowed.

        Returns:
            The action.
        """
        there = [each for each in ACTIONS if mortal or not each.ends_node]
        weights = np.array([each.weight for each in there])
        return there[int(self.random.choice(len(there), p=weights / weights.sum()))]

    def choose_from(self, choices: Sequence[Choice]) -> Choice:
        """Return one of several values, all equally likely."""
        return choices[int(self.random.integers(len(choices)))]

    def send_goal(self) -> None:
        """Send one of the goals, which can be reached if no zone or fault prevents it."""
        goal = self.choose_from(self.goals)
        self.actor.send_goal(goal.position)

    def send_invalid_goal(self) -> None:
        """Send a goal that must be refused."""
        self.actor.send_message(make_invalid_goal(self.random, self.machine))

    def send_goal_burst(self) -> None:
        """Send goals faster than they can be planned."""
        for _ in range(int(self.random.integers(3, 9))):
            self.send_goal()
            self.actor.wait(self.random.uniform(0.0, 0.05))

    def stop(self) -> None:
        """Stop the arm through the planner or the simulator."""
        self.actor.call_trigger(ActionKind.STOP, self._choose_node(), "stop")

    def stop_at_once(self) -> None:
        """Send a goal and stop while its plan is being made."""
        self.send_goal()
        self.actor.wait(self.random.uniform(0.0, 0.1))
        self.stop()

    def set_zones(self) -> None:
        """Set up to two zones at random goals, often across the path.

        Zones near the first link are left out.
        """
        size, shape = self.machine.relative_size, "spheres" if self.machine.slews else "circles"
        zones: dict[str, Any] = {shape: (), f"tip_{shape}": ()}
        for _ in range(int(self.random.integers(1, 3))):
            goal = self.choose_from(self.goals)
            if math.hypot(*self.machine.convert_to_plane(goal.position, 0.0).tip) < 0.35 * size:
                continue  # the first link always covers this place
            kind = shape if self.random.random() < 0.5 else f"tip_{shape}"
            zones[kind] += ((*goal.position, size * self.random.uniform(0.03, 0.1)),)
        self.actor.set_zones(Zones(**zones))

    def clear_zones(self) -> None:
        """Remove all zones."""
        self.actor.set_zones(Zones())

    def set_parameter(self) -> None:
        """Set one of the planner's parameters that change its plans."""
        random, arrays = self.random, self.machine.arrays
        motion = self.machine.config.motion
        changes: list[tuple[str, Any]] = [
            ("weights", [0.5, random.uniform(0.0, 15.0), 2.0]),
            ("energy_reading", self.choose_from(["paper", "series"])),
            ("payload", arrays.payload * random.uniform(0.5, 1.1)),
            ("v_max", motion.max_piston_speed * random.uniform(0.5, 1.0)),
            ("planner", self.choose_from(["integrated", "table"])),
        ]
        name, value = self.choose_from(changes)
        self.actor.set_parameter(ActionKind.PARAMETER, PLANNER, name, value)

    def set_invalid_parameter(self) -> None:
        """Set a parameter to a value of unknown type, or delete it; this must be refused."""
        self.actor.set_invalid_parameter(self._choose_node(), self.choose_from([0, 10, 99, 255]))

    def reset(self) -> None:
        """Reset the simulation."""
        self.actor.call_trigger(ActionKind.RESET, SIM, "reset")

    def freeze(self) -> None:
        """Freeze a node for a while; every second time, on average, a goal is sent to it."""
        meanwhile = self.send_goal if self.random.random() < 0.5 else lambda: None
        self.actor.freeze(self._choose_node(), self.random.uniform(0.1, 2.0), meanwhile)

    def kill(self) -> None:
        """Kill a node by SIGKILL."""
        self.actor.end(self._choose_node(), signal.SIGKILL)

    def end(self) -> None:
        """End a node by SIGINT, SIGTERM or SIGHUP."""
        self.actor.end(
            self._choose_node(), self.choose_from([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
        )

    def inject_fault(self) -> None:
        """Inject a fault for a while, usually send a goal, then heal the fault."""
        fault = self.choose_from(FAULTS)
        self.actor.set_parameter(ActionKind.FAULT, SIM, "fault", fault)
        self.actor.wait(self.random.uniform(0.5, 2.0))
        if self.random.random() < 0.7:
            self.send_goal()
            self.actor.wait(self.random.uniform(0.5, 2.0))
        self.heal(fault)

    def heal(self, fault: str = "") -> None:
        """Clear all faults and wait 2 s.

        Args:
            fault: Fault to record with the action; empty if none was injected.
        """
        self.actor.call_trigger(ActionKind.HEAL, SIM, "clear_faults", fault)
        self.actor.wait(2.0)

    def change_payload(self) -> None:
        """Change the payload of the simulated arm; the planner does not know."""
        payload = self.machine.arrays.payload * self.random.uniform(0.8, 1.1)
        self.actor.set_parameter(ActionKind.PARAMETER, SIM, "payload", payload)

    def _choose_node(self) -> str:
        return self.choose_from([PLANNER, SIM])


ACTIONS = (
    ActionChoice(60, Soak.send_goal),
    ActionChoice(6, Soak.send_invalid_goal),
    ActionChoice(5, Soak.send_goal_burst),
    ActionChoice(6, Soak.stop),
    ActionChoice(4, Soak.stop_at_once),
    ActionChoice(5, Soak.set_zones),
    ActionChoice(6, Soak.clear_zones),
    ActionChoice(5, Soak.set_parameter),
    ActionChoice(3, Soak.set_invalid_parameter),
    ActionChoice(3, Soak.reset),
    ActionChoice(4, Soak.freeze),
    ActionChoice(4, Soak.inject_fault),
    ActionChoice(3, Soak.change_payload),
    ActionChoice(6, Soak.kill, ends_node=True),
    ActionChoice(3, Soak.end, ends_node=True),
)


def soak(
    minutes: Annotated[float, NumberRange(0.0, 1e6)] = 10.0,
    machine: OptionalFile = None,
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/soak"),
    seed: Seed = 0,
    json_: JsonFlag = False,
) -> int:
    """Act at random on both nodes, then print each promise and whether it held.

    Actions are goals, floods of goals, stops, zones, parameters, resets, frozen nodes, faults and
    payloads. In the first third of the time nodes are killed, too. Writes DIR/summary.json, the
    nodes' output and a recording, DIR/bag. Runs in the domain of ROS_DOMAIN_ID, where no other
    planner or simulator may be.

    Args:
        minutes: Duration [min]; memory is judged for nodes older than four minutes.
        machine: Machine file (YAML); the suite's own arm when left out.
        output: Folder, whose content is replaced.
        seed: Seed of all random choices.
        json_: Print summary.json instead of text.

    Returns:
        Exit code: 0 if every promise held.
    """
    if not minutes > 0.0:
        raise UsageError(f"--minutes is {minutes:g}; it must be above 0")
    arm, settings = load_machine(machine), (f"machine:={machine}",) if machine else ()
    compile_kernels()
    planner = Planner(arm, load_or_build_table(arm))
    warm_up(planner)
    goals = draw_reachable_goals(planner, GOALS, seed)
    _clear(output)
    command_line.set_interrupt_note(
        f"{output} has recording and output of the nodes, and no summary"
    )
    try:
        events = run_soak(arm, settings, goals, minutes, output, seed)
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    kept = {promise: look(events) for promise, look in PROMISES.items()}
    write_json(output / "summary.json", summary(events, kept, minutes, seed))
    if json_:
        print((output / "summary.json").read_text(encoding="utf-8"))
    else:
        print("\n".join(as_text(kept)))
        print(f"written to {output}/summary.json")
    return 0 if all(each.is_kept for each in kept.values()) else command_line.EXIT_FAILED


def run_soak(
    machine: Machine,
    settings: tuple[str, ...],
    goals: list[SeededGoal],
    minutes: float,
    folder: Path,
    seed: int,
) -> Events:
    """Run both nodes through a soak and record everything.

    Args:
        machine: The arm.
        settings: Parameters `NAME:=VALUE` of both nodes.
        goals: Goals that can be reached.
        minutes: Duration [min].
        folder: Folder for output of the nodes and the recording.
        seed: Seed of all random choices.

    Returns:
        Everything by which the promises are judged.
    """
    with run_ros([]), serve_node(MessageWatcher) as (executor, watcher):
        check_no_other_nodes(watcher, executor)
        actor = Actor(watcher, executor, folder, settings)
        try:
            for node in (SIM, PLANNER):
                actor.start(node)
            watcher.forget()
            begin_ns = time.time_ns()
            Soak(actor, goals, machine, seed).run(60.0 * minutes)
            end_ns = time.time_ns()
        finally:
            actor.end_all()
        watcher.write(folder / "bag")
        recording = watcher.decode_messages(machine.slews)
    return Events(machine, recording, tuple(actor.actions), tuple(actor.lives), begin_ns, end_ns)


def summary(
    events: Events, kept: dict[str, PromiseResult], minutes: float, seed: int
) -> dict[str, Any]:
    """Summarize a soak in plain numbers and sentences for JSON.

    Args:
        events: Everything recorded in the soak.
        kept: Result of each check, by the promise in words.
        minutes: Duration [min].
        seed: Seed of all random choices.

    Returns:
        The content of summary.json.
    """
    reports = [each.value for each in events.recording.reports]
    return {
        "minutes": minutes,
        "seed": seed,
        "held": all(each.is_kept for each in kept.values()),
        "promises": [
            {
                "promise": name,
                "held": each.is_kept,
                "tested": each.tested,
                "broken": each.violations,
            }
            for name, each in kept.items()
        ],
        "deeds": Counter(f"{deed.kind} {deed.node}" for deed in events.actions),
        "verdicts": Counter(each.code for each in reports if isinstance(each, GoalVerdict)),
        "plans": Counter(each.value.outcome for each in events.recording.hand_overs),
        "unreadable": events.recording.unreadable,
        "lives": [
            {
                "name": life.name,
                "seconds": (life.end_ns - life.ready_ns) / SECOND_NS,
                "signal": life.signal,
                "exit_code": life.exit_code,
                "memory_mb": [size / 1e6 for _, size in life.memory[::MEMORY_STRIDE]],
            }
            for life in events.lives
        ],
        "load_average": os.getloadavg()[0],
    }


def as_text(kept: dict[str, PromiseResult]) -> list[str]:
    """Format whether each promise held, and what broke it.

    Args:
        kept: Result of each check, by the promise in words.

    Returns:
        A line for each promise, with at most `BROKEN_SHOWN` sentences below it.
    """
    lines = []
    for name, each in kept.items():
        word = "held" if each.is_kept else "BROKEN"
        word = "not put to the test" if each.tested == 0 and each.is_kept else word
        lines.append(f"{name}: {word} ({each.tested} cases)")
        lines += [f"    {sentence}" for sentence in each.violations[:BROKEN_SHOWN]]
        if (more := len(each.violations) - BROKEN_SHOWN) > 0:
            lines.append(f"    and {more} more")
    return lines


def _clear(folder: Path) -> None:
    """Create a folder, and remove an earlier soak's logs, summary and recording from it.

    Args:
        folder: The folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for file in (*folder.glob("*.log"), folder / "summary.json"):
        file.unlink(missing_ok=True)
    if (folder / "bag").is_dir():
        shutil.rmtree(folder / "bag")


def main() -> int:
    """Entry point of `scripts/soak`."""
    return command_line.run(soak, name="soak")


if __name__ == "__main__":
    sys.exit(main())
