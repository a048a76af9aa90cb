"""`scripts/soak`: random goals, stops, kills and faults, and whether every promise held."""

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
from rclpy.executors import ExternalShutdownException
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Seed, UsageError, Within
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import GoalVerdict
from mhsb_msgs_py.node_process import ros_running, serving
from mhsb_planner.planner import Planner, warm_up
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.result_files import write_json
from mhsb_sim.live.nodes import compile_nodes, refuse_company
from mhsb_sim.live.seeded_goals import SeededGoal, seeded_goals
from mhsb_sim.live.soak.actor import Actor, spoilt_goal
from mhsb_sim.live.soak.events import PLANNER, SIM, DeedKind, Events
from mhsb_sim.live.soak.kept import Kept
from mhsb_sim.live.soak.promises import PROMISES
from mhsb_sim.live.watcher import Watcher

GOALS = 100
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
"""Different goals, sent again and again."""

MORTAL_SHARE = 1 / 3
"""Share of the time in which nodes are ended and started anew; memory needs longer lives."""

WAITS = (0.3, 3.0)  # s
LAST_WAIT = 40.0
"""Time in which all executions end [s]."""

BROKEN_SHOWN = 5

Choice = TypeVar("Choice")


@dataclass(frozen=True)
class Action:
    """Something that may be done next.

    weight  how often, against the others
    mortal  whether it ends a node
    """

    weight: float
    do: Callable[[Soak], None]
    mortal: bool = False


class Soak:
    """Does random things to both nodes."""

    def __init__(self, actor: Actor, goals: list[SeededGoal], machine: Machine, seed: int) -> None:
        self.actor, self.goals, self.machine = actor, goals, machine
        self.random = np.random.default_rng(seed)

    def run(self, seconds: float) -> None:
        """Do random things for some time, then nothing, until all is over."""
        began, bar = time.monotonic(), tqdm(total=round(seconds), unit="s", disable=None)
        while (elapsed := time.monotonic() - began) < seconds:
            bar.update(round(elapsed) - bar.n)
            for node in self.actor.missing():
                self.actor.start(node)
            self._choose(mortal=elapsed < MORTAL_SHARE * seconds).do(self)
            self.actor.wait(self.random.uniform(*WAITS))
        bar.close()
        self.heal()
        self.actor.wait(LAST_WAIT)

    def _choose(self, mortal: bool) -> Action:
        there = [each for each in ACTIONS if mortal or not each.mortal]
        weights = np.array([each.weight for each in there])
        return there[int(self.random.choice(len(there), p=weights / weights.sum()))]

    def one_of(self, choices: Sequence[Choice]) -> Choice:
        """One of some things, each as likely as the others."""
        return choices[int(self.random.integers(len(choices)))]

    def send(self) -> None:
        """Send a goal that there is a way to, where nothing is in the way."""
        goal = self.one_of(self.goals)
        self.actor.goal(goal.position)

    def send_spoilt(self) -> None:
        """Send a goal that must be refused."""
        self.actor.message(spoilt_goal(self.random, self.machine))

    def send_many(self) -> None:
        """Send goals faster than they can be planned."""
        for _ in range(int(self.random.integers(3, 9))):
            self.send()
            self.actor.wait(self.random.uniform(0.0, 0.05))

    def stop(self) -> None:
        """Stop the arm, by either node."""
        self.actor.trigger(DeedKind.STOP, self._either(), "stop")

    def stop_at_once(self) -> None:
        """Stop while a plan is being made."""
        self.send()
        self.actor.wait(self.random.uniform(0.0, 0.1))
        self.stop()

    def set_zones(self) -> None:
        """Set one or two zones, often across the way."""
        size, shape = self.machine.scale, "spheres" if self.machine.slews else "circles"
        zones: dict[str, Any] = {shape: (), f"tip_{shape}": ()}
        for _ in range(int(self.random.integers(1, 3))):
            goal = self.one_of(self.goals)
            if math.hypot(*self.machine.in_plane(goal.position, 0.0).tip) < 0.35 * size:
                continue  # the first link that moves in the plane always is there
            kind = shape if self.random.random() < 0.5 else f"tip_{shape}"
            zones[kind] += ((*goal.position, size * self.random.uniform(0.03, 0.1)),)
        self.actor.zones(Zones(**zones))

    def clear_zones(self) -> None:
        """Take all zones back."""
        self.actor.zones(Zones())

    def set_parameter(self) -> None:
        """Change what plans are to be like."""
        random, arrays = self.random, self.machine.arrays
        motion = self.machine.config.motion
        changes: list[tuple[str, Any]] = [
            ("weights", [0.5, random.uniform(0.0, 15.0), 2.0]),
            ("energy_reading", self.one_of(["paper", "series"])),
            ("payload", arrays.payload * random.uniform(0.5, 1.1)),
            ("v_max", motion.max_piston_speed * random.uniform(0.5, 1.0)),
            ("planner", self.one_of(["integrated", "table"])),
        ]
        name, value = self.one_of(changes)
        self.actor.parameter(DeedKind.PARAMETER, PLANNER, name, value)

    def reset(self) -> None:
        """Let the simulation start anew."""
        self.actor.trigger(DeedKind.RESET, SIM, "reset")

    def freeze(self) -> None:
        """Stop a node for a while, in which a goal may come."""
        meanwhile = self.send if self.random.random() < 0.5 else lambda: None
        self.actor.freeze(self._either(), self.random.uniform(0.1, 2.0), meanwhile)

    def kill(self) -> None:
        """Kill a node."""
        self.actor.end(self._either(), signal.SIGKILL)

    def end(self) -> None:
        """Ask a node to end."""
        self.actor.end(self._either(), self.one_of([signal.SIGINT, signal.SIGTERM]))

    def fail(self) -> None:
        """Let something fail for a while, in which goals may come."""
        fault = self.one_of(FAULTS)
        self.actor.parameter(DeedKind.FAULT, SIM, "fault", fault)
        self.actor.wait(self.random.uniform(0.5, 2.0))
        if self.random.random() < 0.7:
            self.send()
            self.actor.wait(self.random.uniform(0.5, 2.0))
        self.heal(fault)

    def heal(self, fault: str = "") -> None:
        """Heal what fails, and watch for a moment."""
        self.actor.trigger(DeedKind.HEAL, SIM, "clear_faults", fault)
        self.actor.wait(2.0)

    def load(self) -> None:
        """Hang another payload at the arm, of which nobody is told."""
        payload = self.machine.arrays.payload * self.random.uniform(0.8, 1.1)
        self.actor.parameter(DeedKind.PARAMETER, SIM, "payload", payload)

    def _either(self) -> str:
        return self.one_of([PLANNER, SIM])


ACTIONS = (
    Action(60, Soak.send),
    Action(6, Soak.send_spoilt),
    Action(5, Soak.send_many),
    Action(6, Soak.stop),
    Action(4, Soak.stop_at_once),
    Action(5, Soak.set_zones),
    Action(6, Soak.clear_zones),
    Action(5, Soak.set_parameter),
    Action(3, Soak.reset),
    Action(4, Soak.freeze),
    Action(4, Soak.fail),
    Action(3, Soak.load),
    Action(6, Soak.kill, mortal=True),
    Action(3, Soak.end, mortal=True),
)


def soak(
    minutes: Annotated[float, Within(0.0, 1e6)] = 10.0,
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/soak"),
    seed: Seed = 0,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Let random things happen to both nodes, print each promise and whether it held.

    Goals, floods, stops, zones, parameters, resets, frozen nodes, faults, payloads; in the first
    third of the time nodes are killed, too. Writes DIR/summary.json, the nodes' output and a
    recording, DIR/bag; runs in the domain of ROS_DOMAIN_ID, where no other planner or simulator
    may be.

    Args:
        minutes: How long [min]; memory is judged for nodes older than three minutes.
        machine: Machine file (YAML); the suite's own arm when left out.
        output: Folder, whose content is replaced.
        seed: Of all that is random.
        json_: Print summary.json instead of text.
    """
    if not minutes > 0.0:
        raise UsageError(f"--minutes is {minutes:g}; it must be above 0")
    arm, settings = load_machine(machine), (f"machine:={machine}",) if machine else ()
    compile_nodes()
    planner = Planner(arm, table_for(arm))
    warm_up(planner)
    goals = seeded_goals(planner, GOALS, seed)
    _clear(output)
    command_line.keep(f"{output} has recording and output of the nodes, and no summary")
    try:
        events = watched(arm, settings, goals, minutes, output, seed)
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    kept = {promise: look(events) for promise, look in PROMISES.items()}
    write_json(output / "summary.json", summary(events, kept, minutes, seed))
    if json_:
        print((output / "summary.json").read_text(encoding="utf-8"))
    else:
        print("\n".join(as_text(kept)))
        print(f"written to {output}/summary.json")
    return 0 if all(each.held for each in kept.values()) else command_line.FAILED


def watched(
    machine: Machine,
    settings: tuple[str, ...],
    goals: list[SeededGoal],
    minutes: float,
    folder: Path,
    seed: int,
) -> Events:
    """Both nodes, with settings NAME:=VALUE, through a soak, and all that happened."""
    with ros_running([]), serving(Watcher) as (executor, watcher):
        refuse_company(watcher, executor)
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
        recording = watcher.recording(machine.slews)
    return Events(machine, recording, tuple(actor.deeds), tuple(actor.lives), begin_ns, end_ns)


def summary(
    events: Events, kept: dict[str, Kept], minutes: float, seed: int
) -> dict[str, Any]:
    """What happened, in plain numbers and sentences."""
    reports = [each.value for each in events.recording.reports]
    return {
        "minutes": minutes,
        "seed": seed,
        "held": all(each.held for each in kept.values()),
        "promises": [
            {"promise": name, "held": each.held, "tested": each.tested, "broken": each.broken}
            for name, each in kept.items()
        ],
        "deeds": Counter(f"{deed.kind} {deed.node}" for deed in events.deeds),
        "verdicts": Counter(each.code for each in reports if isinstance(each, GoalVerdict)),
        "plans": Counter(each.value.outcome for each in events.recording.hand_overs),
        "unreadable": events.recording.unreadable,
        "lives": [
            {
                "name": life.name,
                "seconds": (life.end_ns - life.ready_ns) / SECOND_NS,
                "signal": life.signal,
                "exit_code": life.exit_code,
                "largest_mb": max((size for _, size in life.memory), default=0) / 1e6,
            }
            for life in events.lives
        ],
        "load_average": os.getloadavg()[0],
    }


def as_text(kept: dict[str, Kept]) -> list[str]:
    """Each promise and whether it held, with what broke it."""
    lines = []
    for name, each in kept.items():
        word = "held" if each.held else "BROKEN"
        word = "not put to the test" if each.tested == 0 and each.held else word
        lines.append(f"{name}: {word} ({each.tested} cases)")
        lines += [f"    {sentence}" for sentence in each.broken[:BROKEN_SHOWN]]
        if (more := len(each.broken) - BROKEN_SHOWN) > 0:
            lines.append(f"    and {more} more")
    return lines


def _clear(folder: Path) -> None:
    """Make the folder, without what an earlier soak has left."""
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
