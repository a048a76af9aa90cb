"""Controls beside the scene: goal, stop, settings of the planner, and messages to the user."""

from collections import deque
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from viser import GuiApi

from mhsb_model.goal import Goal, format_position
from mhsb_model.machine import Machine
from mhsb_model.verdict import ExecutionReport, GoalVerdict
from mhsb_tools.viewer.server import LocalServer

MAX_SENTENCES = 6
"""Number of sentences that are shown."""

GIZMO_SIZE = 0.2  # m
FIRST_GOAL = (0.55, 0.30)
"""Goal of the paper's arm that the fields show at the beginning, (x, z) in the arm's plane [m]."""

POSITION_STEP = 0.01  # m


def describe_report(report: GoalVerdict | ExecutionReport) -> str:
    """Return a verdict or an execution report as one line of text.

    Args:
        report: The verdict or execution report.

    Returns:
        For a verdict: its code, goal [m] and sentence. If a new plan was made, also the plan's
        energy [J], number of mode switches and planning time [ms]. For an execution report: its
        outcome and sentence.
    """
    if isinstance(report, ExecutionReport):
        return f"{report.outcome.value}: {report.sentence}"
    words = f"{report.code.value} {format_position(report.goal.position, '.3f')}: {report.sentence}"
    plan = report.plan
    if plan is None or plan.plan_stamp_ns == 0:
        return words
    return (
        f"{words}; {plan.energy_j:.0f} J, {plan.switches} mode switches, "
        f"planned in {plan.plan_ms:.0f} ms"
    )


def make_initial_goal(machine: Machine) -> Goal:
    """Return the goal that the fields of the page show at the beginning.

    It is in front of the arm, at slew angle 0.

    Args:
        machine: The arm; its size scales the position.

    Returns:
        The goal, with the stamp 0.
    """
    tip = machine.relative_size * np.array(FIRST_GOAL)
    return Goal.at(0, machine.convert_to_base(tip, 0.0).tolist())


class PanelActions(Protocol):
    """Interface of the object that carries out the user's commands.

    The web server calls it from its own threads.
    """

    def send_goal(self, *place: float) -> None:
        """Send a goal.

        Args:
            place: x and z, or x, y and z if the arm slews, in `base_link` [m].
        """

    def stop(self) -> None:
        """Stop the arm."""

    def set_planner(self, changes: dict[str, Any]) -> None:
        """Set parameters of the planner.

        Args:
            changes: Values by name of the parameter.
        """

    def show_abilities(self, velocities: bool, regions: bool) -> None:
        """Show or hide what the arm is able to do.

        Args:
            velocities: Whether to show the velocity polytope of the tip.
            regions: Whether to show where boost is needed.
        """


class SentenceList:
    """List of sentences, the newest first and in bold."""

    def __init__(self, gui: GuiApi) -> None:
        """Add an empty text to the controls.

        Args:
            gui: Controls of the browser.
        """
        self._text: Any = gui.add_markdown("")

    def show(self, sentences: Sequence[str]) -> None:
        """Show the last MAX_SENTENCES sentences, the newest first.

        If the text is unchanged, nothing is sent to the browser.

        Args:
            sentences: Sentences from the oldest to the newest.
        """
        newest = [f"**{sentence}**" for sentence in sentences[-1:]]
        others = reversed(sentences[-MAX_SENTENCES:-1])
        text = "\n\n".join([*newest, *others])
        if text != self._text.content:
            self._text.content = text


class Panel:
    """Controls for goal, stop and settings; the goal can also be dragged in the scene."""

    def __init__(
        self,
        server: LocalServer,
        planners: Sequence[str],
        actions: PanelActions,
        initial_goal: Goal,
        size: float = 1.0,
    ) -> None:
        """Add all controls to the page, and to the scene a goal that the user can drag.

        Args:
            server: Web server of the page. Its `on_refusal` is replaced, so that refused input is
                shown as a sentence.
            planners: Names of the planners to choose from.
            actions: Object whose methods are called, in the server's threads, if the user operates
                a control.
            initial_goal: Goal that the fields show at the beginning. If its y is None, the page has
                no field for y.
            size: Size of the arm relative to the paper's arm; the goal in the scene is scaled by
                it.
        """
        gui = server.gui
        self._sentences: deque[str] = deque(maxlen=MAX_SENTENCES)
        self._actions = actions
        self._state: Any = gui.add_markdown("waiting for the arm …")
        with gui.add_folder("Goal"):
            hints = {"x": "forward", "y": "to the left", "z": "up"}
            places = {"x": initial_goal.x, "y": initial_goal.y, "z": initial_goal.z}
            self._numbers: dict[str, Any] = {
                axis: gui.add_number(
                    f"{axis} [m]", at, step=POSITION_STEP, hint=f"{hints[axis]}, from the base"
                )
                for axis, at in places.items()
                if at is not None
            }
            go = gui.add_button("Go")
            stop = gui.add_button("Stop", color="red")
        self._sentence_list = SentenceList(gui)
        server.on_refusal = self.add_sentence
        with gui.add_folder("Planner", expand_by_default=False):
            self._planner: Any = gui.add_dropdown("planner", tuple(planners))
            self._weights: Any = gui.add_vector3(
                "weights", (0.5, 0.0, 2.0), min=(0.0, 0.0, 0.0), step=0.1,
                hint="of energy [1/J], time [1/s] and mode switches",
            )  # fmt: skip
            self._payload: Any = gui.add_number("payload [kg]", 10.0, min=0.0, step=0.5)
            apply = gui.add_button("Apply")
        with gui.add_folder("Show"):
            self._velocities: Any = gui.add_checkbox(
                "velocities of the tip", True,
                hint="that its posture and modes allow: the velocity polytope",
            )  # fmt: skip
            self._regions: Any = gui.add_checkbox(
                "where boost is needed", False,
                hint="by the planner's payload; pale N, blue DB, orange SB, red none will do",
            )  # fmt: skip
        self._gizmo: Any = server.scene.add_transform_controls(
            "/goal", scale=size * GIZMO_SIZE, active_axes=(True, "y" in self._numbers, True),
            disable_rotations=True, position=(initial_goal.x, initial_goal.y or 0.0,
            initial_goal.z),
        )  # fmt: skip
        go.on_click(lambda _: self._go())
        stop.on_click(lambda _: actions.stop())
        apply.on_click(lambda _: actions.set_planner(self._settings()))
        for box in (self._velocities, self._regions):
            box.on_update(
                lambda _: actions.show_abilities(self._velocities.value, self._regions.value)
            )
        self._gizmo.on_update(lambda event: self._on_drag(ended=event.phase == "end"))
        for number in self._numbers.values():
            number.on_update(lambda event: self._on_edit() if event.client else None)

    def show_state(self, sentence: str) -> None:
        """Show the state of the arm as one sentence above the controls.

        Args:
            sentence: The sentence; it may contain Markdown. If it is unchanged, nothing is sent to
                the browser.
        """
        if sentence != self._state.content:
            self._state.content = sentence

    def show_settings(self, values: dict[str, Any]) -> None:
        """Show the planner's parameters in the fields of the page.

        Args:
            values: Values of `planner` (name), `weights` (of energy, time and mode switches) and
                `payload` [kg].
        """
        self._planner.value = values["planner"]
        self._weights.value = tuple(values["weights"])
        self._payload.value = values["payload"]

    def add_sentence(self, sentence: str) -> None:
        """Add a sentence to the list on the page if it differs from the previous sentence.

        Args:
            sentence: The sentence. Only the last MAX_SENTENCES sentences are kept.
        """
        if self._sentences and self._sentences[-1] == sentence:
            return
        self._sentences.append(sentence)
        self._sentence_list.show(list(self._sentences))

    def _settings(self) -> dict[str, Any]:
        """Return the planner's parameters as the fields show them.

        Returns:
            Values of `planner` (name), `weights` (of energy, time and mode switches) and `payload`
            [kg].
        """
        return {
            "planner": self._planner.value,
            "weights": [float(weight) for weight in self._weights.value],
            "payload": float(self._payload.value),
        }

    def _go(self) -> None:
        """Send the goal that the fields show."""
        self._actions.send_goal(*(float(number.value) for number in self._numbers.values()))

    def _on_drag(self, *, ended: bool) -> None:
        """Copy the position of the dragged goal into the fields, rounded to 1 mm.

        Args:
            ended: True if the user has released the goal. It is then sent.
        """
        for axis, at in zip("xyz", self._gizmo.position, strict=True):
            if axis in self._numbers:
                self._numbers[axis].value = round(float(at), 3)
        if ended:
            self._go()

    def _on_edit(self) -> None:
        """Move the goal in the scene to the position that the fields show."""
        shown = {axis: float(number.value) for axis, number in self._numbers.items()}
        self._gizmo.position = tuple(shown.get(axis, 0.0) for axis in "xyz")
