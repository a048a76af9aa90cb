"""Supervision: warns of symptoms, stops the arm before they become harm, and holds it stopped.

    watching → stopping → closed → held → venting → watching

Beyond a limit the reference decelerates along its path. Where the following error still grows, or
rest does not come, or a part has failed without which nobody can brake, the valves close at once,
else when the arm rests. A servo pump that fails stops nothing: the servo does without it. At rest
the reference is set to the measured posture; nowhere else does it step. So the arm stays where it
is, whatever heals, and once it is released the valves remain closed until the next plan opens them,
to a servo that remembers nothing of what was before.
"""

from __future__ import annotations

from collections import deque
from enum import Enum

import numpy as np

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.diagnosis import ServoPumpWatch
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, Sample
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.symptoms import (
    SYMPTOMS,
    FollowingError,
    SupervisionLimits,
    Symptom,
)

GROWN = 2.0
"""Following error, in limits, at which a stopping arm's valves close."""

LONGEST_STOP_NS = 3 * SECOND_NS
"""Time that a stopping arm has to come to rest before its valves close."""

REST_NS = 300_000_000
REST_SWAY = 2e-3
"""An arm rests whose joints have stayed within this [rad] for `REST_NS`; one that a servo holds
hums."""

LOOKS_AT_REST = REST_NS // WATCH_PERIOD_NS

VENTING_RATE = 6e6
"""At which trapped oil is let down before valves open again [Pa/s]."""

DRIFT = 1e-3
"""Following error of a held arm from which on the reference is set anew at its release [rad]."""


class Phase(Enum):
    """Where supervision stands; the value tells a person."""

    WATCHING = ""
    STOPPING = "the arm is being stopped"
    CLOSED = "the valves have been closed"
    HELD = "the arm has been stopped, its valves are closed and its reference is where it stands"
    VENTING = "the arm is about to be released"


class Supervision:
    """Watches a simulator's arm; `watch` is to be called every `WATCH_PERIOD_NS`.

    limits   may be replaced at any time
    phase    where it stands
    fault    why the arm has been stopped, empty while it has not
    warning  what is beyond its first limit, empty where nothing is
    """

    def __init__(self, simulator: Simulator, limits: SupervisionLimits) -> None:
        self._simulator = simulator
        self.limits = limits
        self.restart()

    def restart(self) -> None:
        """Watch an arm that rests and has no history."""
        self._symptoms: list[Symptom] = [kind(self._simulator.machine) for kind in SYMPTOMS]
        self._following = FollowingError(self._simulator.machine)
        self._pumps = ServoPumpWatch(self._simulator.machine)
        self._simulator.lose_modules(())
        self.phase = Phase.WATCHING
        self.fault = self.warning = ""
        self._since_ns = self._simulator.time_ns
        self._stayed: deque[FloatArray] = deque(maxlen=LOOKS_AT_REST)

    def watch(self) -> None:
        """Look at the arm, and do what follows."""
        now, sample = self._simulator.time_ns, Sample.of(self._simulator)
        self._stayed.append(sample.measured.position)
        if sample.reference.velocity.any():
            self._stayed.clear()
        if self.phase is Phase.WATCHING:
            self._judge(sample)
        elif self.phase is Phase.STOPPING:
            grown = self._following.look(sample).value > GROWN * self.limits.following_error[1]
            if grown or self.rests or now - self._since_ns > LONGEST_STOP_NS:
                self._simulator.close_valves()
                self._enter(Phase.CLOSED)
        elif self.phase is Phase.CLOSED and self.rests:
            self._simulator.hold_here()
            self._enter(Phase.HELD)
        elif self.phase is Phase.VENTING:
            vented = self._simulator.vent(VENTING_RATE * WATCH_PERIOD_NS / SECOND_NS)
            if vented and self.rests:
                self._release(sample)

    @property
    def rests(self) -> bool:
        """Whether arm and reference have been at rest for a while."""
        if len(self._stayed) < LOOKS_AT_REST:
            return False
        return float(np.ptp(self._stayed, axis=0).max()) < REST_SWAY

    def trust_servo_pumps(self) -> str:
        """Use all servo pumps again; which had been found to fail, in words, empty if none."""
        failed = ", ".join(self._pumps.failures.values())
        self._pumps = ServoPumpWatch(self._simulator.machine)
        self._simulator.lose_modules(())
        return failed

    def release(self) -> None:
        """Let an arm that is held go on, as soon as no oil is trapped; with the next plan."""
        if self.phase is Phase.HELD:
            self._enter(Phase.VENTING)

    def _release(self, sample: Sample) -> None:
        if self._following.look(sample).value > DRIFT:
            self._simulator.hold_here()
        self.restart()

    def _judge(self, sample: Sample) -> None:
        if self._pumps.look(sample.sensed):
            self._simulator.lose_modules(self._pumps.failures)
        self.warning = ""
        for symptom in self._symptoms:
            finding = symptom.look(sample)
            warning, limit = getattr(self.limits, symptom.name)
            allowed = f"{limit:g} {symptom.unit}".rstrip()
            if finding.value > limit:
                why = filter(None, [self._pumps.suspicion(sample.sensed), finding.text])
                self._trip(f"{'; '.join(why)}, at most {allowed} is allowed", symptom.closes)
                return
            if finding.value > warning and not self.warning:
                self.warning = f"{finding.text}, beyond {allowed} the arm is stopped"
        if self._pumps.failures:
            without = f"{', '.join(self._pumps.failures.values())}; the arm does without"
            self.warning = "; ".join(filter(None, [without, self.warning]))

    def _trip(self, fault: str, closes: bool) -> None:
        self.fault, self.warning = fault, ""
        self._simulator.stop()
        self._enter(Phase.STOPPING)
        if closes:
            self._simulator.close_valves()
            self._enter(Phase.CLOSED)

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self._since_ns = self._simulator.time_ns
        self._stayed.clear()
