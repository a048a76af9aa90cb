"""Supervision: warns of symptoms, stops the arm before harm is done, and keeps it stopped.

    watching → stopping → closed → held → venting → watching

If a symptom exceeds its stop limit, the reference decelerates along its path. The valves close when
the arm rests. They close earlier if the following error grows further, or if the arm does not come
to rest in time. They close at once if a part has failed that is needed for braking. A failed servo
pump does not stop the arm: the servo does without it.

When the arm rests, the reference is set to the arm's actual posture. This is the only case in which
the reference jumps. So the arm stays where it is, even if the fault disappears. After the release
of the arm the valves stay closed until the next plan opens them. The servo then starts without its
former state.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np

from mhsb_control import measures_pressures
from mhsb_model.goal import format_distance
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.fault_detection import (
    PRESSURE_SYMPTOM_KINDS,
    SYMPTOM_KINDS,
    FollowingError,
    SupervisionLimits,
)
from mhsb_sim.simulation.fault_isolation import ServoPumpMonitor
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS, ArmSample, Symptom
from mhsb_sim.simulation.simulator import Simulator


@dataclass(frozen=True)
class SupervisionSettings:
    """Tuned numbers of how an arm is stopped and released.

    Their sensitivity has not been measured: draws of random plants run without supervision.
    """

    closing_error_factor: float = 2.0
    """Following error at which the valves of a stopping arm close [its limit], 1 … 10.

    Origin: chosen; twice the error at which the stop began shows that braking does not help."""
    longest_stop_ns: int = 3 * SECOND_NS
    """Time in which a stopping arm has to come to rest before its valves close [ns], 1e8 … 1e11.

    Origin: chosen."""
    rest_ns: int = 300_000_000
    """Time for which the joints must have stayed within `rest_sway` to rest [ns], 2e7 … 1e10.

    Origin: two periods of the lowest hydro-mechanical mode of the suite's own arm (5 … 8 Hz)."""
    rest_sway: float = 2e-3
    """Range of a joint's positions within which the arm rests [rad or m], 1e-5 … 0.1.

    Origin: chosen; an arm that a servo holds vibrates by less."""
    venting_rate: float = 6e6
    """Rate at which the pressure of trapped oil is lowered before valves open [Pa/s], 1e5 … 1e9.

    Origin: chosen; 10 MPa in less than two seconds."""

    @property
    def rest_samples(self) -> int:
        """Number of samples in `rest_ns`."""
        return self.rest_ns // WATCH_PERIOD_NS


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
        settings: Tuned numbers of all supervisions.
        limits: Limits of the symptoms; may be replaced at any time.
        phase: Present phase.
        fault: Sentence that says why the arm has been stopped; empty if it has not been stopped.
        warning: Warning of failed servo pumps and of the first symptom above its warning value;
            empty if there is neither.
    """

    settings: ClassVar[SupervisionSettings] = SupervisionSettings()

    def __init__(self, simulator: Simulator, limits: SupervisionLimits) -> None:
        """Start to watch a simulator that is at rest.

        Args:
            simulator: The simulator.
            limits: Limits of the symptoms, each as a pair (value to warn, value to stop the arm).
        """
        self._simulator = simulator
        self.limits = limits
        self.restart()

    def restart(self) -> None:
        """Begin again in phase WATCHING, without fault, warning or history.

        The servo of the simulator may use all servo pumps again. Symptoms that need pressure
        sensors are evaluated only if the arm has such sensors.
        """
        machine = self._simulator.machine
        omitted = () if measures_pressures(machine) else PRESSURE_SYMPTOM_KINDS
        self._symptoms: list[Symptom] = [
            kind(machine) for kind in SYMPTOM_KINDS if kind not in omitted
        ]
        self._following = FollowingError(self._simulator.machine)
        self._pumps = ServoPumpMonitor(self._simulator.machine)
        self._simulator.disable_modules(())
        self.phase = Phase.WATCHING
        self.fault = self.warning = ""
        self._since_ns = self._simulator.time_ns
        self._stayed: deque[FloatArray] = deque(maxlen=self.settings.rest_samples)

    def watch(self) -> None:
        """Take a sample of the arm, and act on it according to the phase.

        - WATCHING: symptoms are evaluated. They may warn or begin a stop (STOPPING).
        - STOPPING: the valves close (CLOSED) as soon as the arm rests, `longest_stop_ns` is over,
          or the following error exceeds `closing_error_factor` times its limit.
        - CLOSED: as soon as the arm rests, the reference is set to the arm's posture (HELD).
        - HELD: nothing happens. `release` begins VENTING.
        - VENTING: the pressure of trapped oil is lowered. When no oil is trapped and the arm rests,
          the reference is set to the arm's posture, and WATCHING begins again.
        """
        settings = self.settings
        now, sample = self._simulator.time_ns, ArmSample.from_simulator(self._simulator)
        self._stayed.append(sample.measured.position)
        if sample.reference.velocity.any():
            self._stayed.clear()
        if self.phase is Phase.WATCHING:
            self._evaluate_symptoms(sample)
        elif self.phase is Phase.STOPPING:
            grown = (
                self._following.evaluate(sample).value
                > settings.closing_error_factor * self.limits.following_error[1]
            )
            if grown or self.rests or now - self._since_ns > settings.longest_stop_ns:
                self._simulator.close_valves()
                self._enter(Phase.CLOSED)
        elif self.phase is Phase.CLOSED and self.rests:
            self._simulator.hold_here()
            self._enter(Phase.HELD)
        elif self.phase is Phase.VENTING:
            vented = self._simulator.lower_trapped_pressure(
                settings.venting_rate * WATCH_PERIOD_NS / SECOND_NS
            )
            if vented and self.rests:
                self._simulator.hold_here()
                self.restart()

    @property
    def rests(self) -> bool:
        """True if all joints and the reference have been at rest for `rest_ns`.

        A joint rests if its measured positions stay within a range of `rest_sway`.
        """
        if len(self._stayed) < self.settings.rest_samples:
            return False
        return float(np.ptp(self._stayed, axis=0).max()) < self.settings.rest_sway

    def restore_servo_pumps(self) -> str:
        """Use all servo pumps again, also pumps that had been found to fail.

        Returns:
            Clauses on the pumps that had failed; empty if there were none.
        """
        failed = ", ".join(self._pumps.failures.values())
        self._pumps = ServoPumpMonitor(self._simulator.machine)
        self._simulator.disable_modules(())
        return failed

    def release(self) -> None:
        """Begin to release a held arm; nothing happens in other phases than HELD.

        The phase becomes VENTING. `watch` ends the stop when no oil is trapped and the arm rests.
        The arm then moves with the next plan. Its valves stay closed until then.
        """
        if self.phase is Phase.HELD:
            self._enter(Phase.VENTING)

    def _evaluate_symptoms(self, sample: ArmSample) -> None:
        """Evaluate servo pumps and symptoms, and warn or stop the arm if necessary.

        Servo pumps that have failed are no longer used. The first symptom above its stop limit
        stops the arm; each kind of symptom declares whether the arm then brakes or closes its
        valves. Otherwise `warning` is set. It names the failed pumps and the first symptom above
        its warning limit.

        Args:
            sample: State of the arm.
        """
        if self._pumps.update(sample.sensed):
            self._simulator.disable_modules(self._pumps.failures)
        self.warning = ""
        for symptom in self._symptoms:
            finding = symptom.evaluate(sample)
            warning, limit = getattr(self.limits, symptom.name)
            if not finding.value > min(warning, limit):
                continue
            text, allowed = finding.describe(), f"{limit:g} {symptom.unit}".rstrip()
            if symptom.unit == "m":
                allowed = format_distance(limit)
            if finding.value > limit:
                why = filter(None, [self._pumps.describe_suspects(sample.sensed), text])
                self._stop_for_fault(
                    f"{'; '.join(why)}, at most {allowed} is allowed", symptom.closes_valves
                )
                return
            self.warning = self.warning or f"{text}, beyond {allowed} the arm is stopped"
        if self._pumps.failures:
            without = f"{', '.join(self._pumps.failures.values())}; the arm does without"
            self.warning = "; ".join(filter(None, [without, self.warning]))

    def _stop_for_fault(self, fault: str, closes: bool) -> None:
        """Stop the arm because of a fault, by braking or by closing its valves.

        If the arm brakes, the reference decelerates along its path (phase STOPPING). If the valves
        close, the servo does not act (phase CLOSED). `fault` is stored, and `warning` becomes
        empty.

        Args:
            fault: Sentence that describes the fault.
            closes: True closes the valves at once; False brakes.
        """
        self.fault, self.warning = fault, ""
        self._simulator.stop()
        self._enter(Phase.STOPPING)
        if closes:
            self._simulator.close_valves()
            self._enter(Phase.CLOSED)

    def _enter(self, phase: Phase) -> None:
        """Set the phase and the time at which it began, and forget the samples of the arm at rest.

        So the arm must rest for the whole time `rest_ns` again in the new phase.

        Args:
            phase: The new phase.
        """
        self.phase = phase
        self._since_ns = self._simulator.time_ns
        self._stayed.clear()
