"""Supervision: warns of symptoms, stops the arm before harm is done, and keeps it stopped.

    watching → stopping → closed → held → venting → watching

Beyond a limit the reference decelerates along its path. The valves close when the arm rests. They
close earlier if the following error grows further or if rest does not come in time. They close at
once if a part has failed that braking needs. A failed servo pump stops nothing: the servo does
without it.

Once the arm rests, the reference is set to the arm's actual posture. It never steps otherwise. The
arm therefore stays where it is, even if the fault disappears. After its release the valves stay
closed until the next plan opens them. The servo then starts without memory of what was before.
"""

from __future__ import annotations

from collections import deque
from enum import Enum

import numpy as np

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.fault_detection import (
    SYMPTOM_KINDS,
    FollowingError,
    SupervisionLimits,
    Symptom,
)
from mhsb_sim.simulation.fault_isolation import ServoPumpMonitor
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, ArmSample
from mhsb_sim.simulation.simulator import Simulator

CLOSING_ERROR_FACTOR = 2.0
"""Following error at which the valves of a stopping arm close, as a multiple of its limit [-]."""

LONGEST_STOP_NS = 3 * SECOND_NS
"""Time in which a stopping arm has to come to rest before its valves close [ns]."""

REST_NS = 300_000_000
"""Time for which the joints must have stayed within REST_SWAY for the arm to rest [ns]."""
REST_SWAY = 2e-3
"""Range of a joint's positions within which the arm counts as resting [rad or m].

An arm that a servo holds vibrates.
"""

LOOKS_AT_REST = REST_NS // WATCH_PERIOD_NS
"""Number of samples in REST_NS."""

VENTING_RATE = 6e6
"""Rate at which the pressure of trapped oil is lowered before valves open again [Pa/s]."""

RELEASE_ERROR = 1e-3
"""Following error of a held arm above which the reference is set again at its release [rad]."""


class Phase(Enum):
    """State of supervision; the value is a clause for a person."""

    WATCHING = ""
    STOPPING = "the arm is being stopped"
    CLOSED = "the valves have been closed"
    HELD = "the arm has been stopped, its valves are closed and its reference is where it stands"
    VENTING = "the arm is about to be released"


class Supervision:
    """Supervision of a simulator's arm; call `watch` every `WATCH_PERIOD_NS`.

    Attributes:
        limits: Limits of the symptoms; may be replaced at any time.
        phase: Present phase.
        fault: Why the arm has been stopped; empty if it has not.
        warning: Text on failed servo pumps and on the first symptom above its warning value; empty
            if there is neither.
    """

    def __init__(self, simulator: Simulator, limits: SupervisionLimits) -> None:
        """Start to watch a simulator that is at rest.

        Args:
            simulator: The simulator.
            limits: Limits of the symptoms.
        """
        self._simulator = simulator
        self.limits = limits
        self.restart()

    def restart(self) -> None:
        """Begin anew in phase WATCHING: no faults, no history, all servo pumps in use."""
        self._symptoms: list[Symptom] = [kind(self._simulator.machine) for kind in SYMPTOM_KINDS]
        self._following = FollowingError(self._simulator.machine)
        self._pumps = ServoPumpMonitor(self._simulator.machine)
        self._simulator.disable_modules(())
        self.phase = Phase.WATCHING
        self.fault = self.warning = ""
        self._since_ns = self._simulator.time_ns
        self._stayed: deque[FloatArray] = deque(maxlen=LOOKS_AT_REST)

    def watch(self) -> None:
        """Take a sample of the arm, and act on it according to the phase.

        In phase WATCHING, symptoms are evaluated, which warn or begin a stop. In STOPPING, the
        valves close once one of three things holds. The arm rests, LONGEST_STOP_NS has passed, or
        the following error exceeds CLOSING_ERROR_FACTOR times its limit. In CLOSED, the reference
        is set to the arm's posture once the arm rests (HELD). In VENTING, the pressure of trapped
        oil is lowered; the arm is released when none is trapped and it rests.
        """
        now, sample = self._simulator.time_ns, ArmSample.from_simulator(self._simulator)
        self._stayed.append(sample.measured.position)
        if sample.reference.velocity.any():
            self._stayed.clear()
        if self.phase is Phase.WATCHING:
            self._evaluate_symptoms(sample)
        elif self.phase is Phase.STOPPING:
            grown = (
                self._following.evaluate(sample).value
                > CLOSING_ERROR_FACTOR * self.limits.following_error[1]
            )
            if grown or self.rests or now - self._since_ns > LONGEST_STOP_NS:
                self._simulator.close_valves()
                self._enter(Phase.CLOSED)
        elif self.phase is Phase.CLOSED and self.rests:
            self._simulator.hold_here()
            self._enter(Phase.HELD)
        elif self.phase is Phase.VENTING:
            vented = self._simulator.lower_trapped_pressure(
                VENTING_RATE * WATCH_PERIOD_NS / SECOND_NS
            )
            if vented and self.rests:
                self._release(sample)

    @property
    def rests(self) -> bool:
        """True if joints and reference have been at rest for REST_NS."""
        if len(self._stayed) < LOOKS_AT_REST:
            return False
        return float(np.ptp(self._stayed, axis=0).max()) < REST_SWAY

    def restore_servo_pumps(self) -> str:
        """Use all servo pumps again, also those that had been found to fail.

        Returns:
            Clauses on the pumps that had been found to fail; empty if there were none.
        """
        failed = ", ".join(self._pumps.failures.values())
        self._pumps = ServoPumpMonitor(self._simulator.machine)
        self._simulator.disable_modules(())
        return failed

    def release(self) -> None:
        """Start to release a held arm; no effect in other phases.

        The phase becomes VENTING. `watch` releases the arm once no oil is trapped and it rests. The
        arm moves with the next plan.
        """
        if self.phase is Phase.HELD:
            self._enter(Phase.VENTING)

    def _release(self, sample: ArmSample) -> None:
        """End a stop: supervision begins anew in phase WATCHING, without faults or history.

        All servo pumps are in use again. If the following error exceeds RELEASE_ERROR, the
        reference is first set to the arm's posture. The valves stay closed until the next plan.

        Args:
            sample: State of the arm.
        """
        if self._following.evaluate(sample).value > RELEASE_ERROR:
            self._simulator.hold_here()
        self.restart()

    def _evaluate_symptoms(self, sample: ArmSample) -> None:
        """Evaluate servo pumps and symptoms: stop using failed pumps, warn, or stop the arm.

        The first symptom above its limit stops the arm. The warning names the failed pumps and the
        first symptom above its warning value.

        Args:
            sample: State of the arm.
        """
        if self._pumps.update(sample.sensed):
            self._simulator.disable_modules(self._pumps.failures)
        self.warning = ""
        for symptom in self._symptoms:
            finding = symptom.evaluate(sample)
            warning, limit = getattr(self.limits, symptom.name)
            allowed = f"{limit:g} {symptom.unit}".rstrip()
            if finding.value > limit:
                why = filter(None, [self._pumps.describe_suspects(sample.sensed), finding.text])
                self._stop_for_fault(
                    f"{'; '.join(why)}, at most {allowed} is allowed", symptom.closes_valves
                )
                return
            if finding.value > warning and not self.warning:
                self.warning = f"{finding.text}, beyond {allowed} the arm is stopped"
        if self._pumps.failures:
            without = f"{', '.join(self._pumps.failures.values())}; the arm does without"
            self.warning = "; ".join(filter(None, [without, self.warning]))

    def _stop_for_fault(self, fault: str, closes: bool) -> None:
        """Stop the arm because of a fault: decelerate along the path, or close the valves at once.

        `fault` is stored and the warning is cleared. The phase becomes STOPPING, or CLOSED if the
        valves close.

        Args:
            fault: Sentence on the fault.
            closes: Whether the valves close at once.
        """
        self.fault, self.warning = fault, ""
        self._simulator.stop()
        self._enter(Phase.STOPPING)
        if closes:
            self._simulator.close_valves()
            self._enter(Phase.CLOSED)

    def _enter(self, phase: Phase) -> None:
        """Set the phase and the time at which it began, and forget the samples that show rest.

        The samples are measured joint positions.

        Args:
            phase: The new phase.
        """
        self.phase = phase
        self._since_ns = self._simulator.time_ns
        self._stayed.clear()
