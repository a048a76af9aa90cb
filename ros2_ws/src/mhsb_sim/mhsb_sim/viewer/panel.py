"""The controls beside the scene: goal, stop, the planner's settings, and what has been said."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from viser import GuiApi, ViserServer

from mhsb_model.goal import Goal
from mhsb_model.machine import Machine

MOST_SAID = 6
"""Sentences that are shown, the newest first."""

GIZMO_SIZE = 0.2  # m
FIRST_GOAL = (0.55, 0.30)  # m, of an arm of the paper's size
STEP = 0.01  # m


def first_goal(machine: Machine) -> Goal:
    """Somewhere ahead of the arm."""
    tip = machine.scale * np.array(FIRST_GOAL)
    return Goal.at(0, machine.in_base(tip, 0.0).tolist())


class Deeds(Protocol):
    """What the controls ask for; called from the threads of the server."""

    def go(self, *place: float) -> None:
        """Send a goal [m]."""

    def stop(self) -> None:
        """Have the arm stop."""

    def set_planner(self, changes: dict[str, Any]) -> None:
        """Set parameters of the planner."""

    def show_abilities(self, velocities: bool, regions: bool) -> None:
        """Show or hide what the arm is able to do."""


class Said:
    """Sentences, the newest first and bold."""

    def __init__(self, gui: GuiApi) -> None:
        self._text: Any = gui.add_markdown("")

    def show(self, sentences: Sequence[str]) -> None:
        """The last ones of these, given in their order."""
        newest = [f"**{sentence}**" for sentence in sentences[-1:]]
        others = reversed(sentences[-MOST_SAID:-1])
        text = "\n\n".join([*newest, *others])
        if text != self._text.content:
            self._text.content = text


class Panel:
    """Goal, stop and settings; a goal can also be dragged in the scene."""

    def __init__(
        self,
        server: ViserServer,
        planners: Sequence[str],
        deeds: Deeds,
        first: Goal,
        size: float = 1.0,
    ) -> None:
        """first: what stands there as goal at the beginning; size: of the arm, the paper's is 1."""
        gui = server.gui
        self._sentences: deque[str] = deque(maxlen=MOST_SAID)
        self._deeds = deeds
        self._state: Any = gui.add_markdown("waiting for the arm …")
        with gui.add_folder("Goal"):
            hints = {"x": "forward", "y": "to the left", "z": "up"}
            places = {"x": first.x, "y": first.y, "z": first.z}
            self._numbers: dict[str, Any] = {
                axis: gui.add_number(
                    f"{axis} [m]", at, step=STEP, hint=f"{hints[axis]}, from the base"
                )
                for axis, at in places.items()
                if at is not None
            }
            go = gui.add_button("Go")
            stop = gui.add_button("Stop", color="red")
        self._said = Said(gui)
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
            disable_rotations=True, position=(first.x, first.y or 0.0, first.z),
        )  # fmt: skip
        go.on_click(lambda _: self._go())
        stop.on_click(lambda _: deeds.stop())
        apply.on_click(lambda _: deeds.set_planner(self._settings()))
        for box in (self._velocities, self._regions):
            box.on_update(
                lambda _: deeds.show_abilities(self._velocities.value, self._regions.value)
            )
        self._gizmo.on_update(lambda _: self._dragged())
        self._gizmo.on_drag_end(lambda _: self._go())
        for number in self._numbers.values():
            number.on_update(lambda event: self._typed() if event.client else None)

    def show_state(self, sentence: str) -> None:
        """What the arm is at, in one sentence."""
        if sentence != self._state.content:
            self._state.content = sentence

    def show_settings(self, values: dict[str, Any]) -> None:
        """What the planner's parameters are."""
        self._planner.value = values["planner"]
        self._weights.value = tuple(values["weights"])
        self._payload.value = values["payload"]

    def say(self, sentence: str) -> None:
        """Add a sentence to those that are shown."""
        self._sentences.append(sentence)
        self._said.show(list(self._sentences))

    def _settings(self) -> dict[str, Any]:
        return {
            "planner": self._planner.value,
            "weights": [float(weight) for weight in self._weights.value],
            "payload": float(self._payload.value),
        }

    def _go(self) -> None:
        self._deeds.go(*(float(number.value) for number in self._numbers.values()))

    def _dragged(self) -> None:
        for axis, at in zip("xyz", self._gizmo.position, strict=True):
            if axis in self._numbers:
                self._numbers[axis].value = round(float(at), 3)

    def _typed(self) -> None:
        shown = {axis: float(number.value) for axis, number in self._numbers.items()}
        self._gizmo.position = tuple(shown.get(axis, 0.0) for axis in "xyz")


