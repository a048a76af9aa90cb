"""Health of the simulator in one sentence: its fault, or all its warnings, or that it runs."""

import time
from typing import Any

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Level
from mhsb_msgs_py.faults import Faults
from mhsb_sim.ros.pacing import Pacer
from mhsb_sim.simulation.supervised_arm import SupervisedArm

LARGEST_OFFSET_NS = SECOND_NS // 2
"""Largest difference between system time and simulated time without a warning [ns]."""


WARNING_HOLD_NS = 2 * SECOND_NS
"""Simulated time for which a warning must be absent before it counts as ended [ns].

So a warning that comes and goes many times a second is logged once.
"""

VALVES_CLOSED_SENTENCE = "running; the valves are closed until the next plan"
"""Sentence while nothing is wrong and the valves are closed."""


class Health:
    """Health of an arm and its node, summed up as a level and a sentence.

    The health depends on the arm's fault and warnings, the lag of the simulation, the clock offset,
    failed callbacks and duplicate publishers.

    Attributes:
        duplicates: Clause that names topics with a second publisher on the ROS graph; empty if
            there are none. See `mhsb_msgs_py.endpoints`.
    """

    def __init__(self, arm: SupervisedArm, pacer: Pacer, own_clock: bool, faults: Faults) -> None:
        """Store the objects on which the health depends.

        Args:
            arm: The arm.
            pacer: Maps real time to simulated time, and knows the lag of the simulation.
            own_clock: Whether the simulator publishes /clock. Simulated time may then differ from
                the system's time.
            faults: Record of the node's failed callbacks.
        """
        self._arm = arm
        self._pacer = pacer
        self._own_clock = own_clock
        self._faults = faults
        self.duplicates = ""
        self._last_key: tuple[object, ...] | None = None
        self._warned_ns: dict[int, int] = {}

    @property
    def level(self) -> Level:
        """Level of the health: ERROR if the arm is stopped, WARN if there is a warning, else OK."""
        if self._arm.fault:
            return Level.ERROR
        return Level.WARN if any(self._list_warnings()) else Level.OK

    @property
    def sentence(self) -> str:
        """Health of the simulator as text for a person.

        It describes the fault if there is one. Otherwise it lists all warnings. Without warnings it
        says that the valves are closed, or that the simulator runs.
        """
        well = VALVES_CLOSED_SENTENCE if self._arm.simulator.valves_closed else "running"
        return self._arm.fault or "; ".join(filter(None, self._list_warnings())) or well

    def has_changed(self) -> bool:
        """Return whether the health has changed in kind since the previous call.

        The kind consists of the state of the arm, the set of present warnings, and the text on
        duplicate publishers. Numbers in the other warnings do not belong to it. A warning counts as
        present until it has been absent for `WARNING_HOLD_NS`. A call of ~/stop is a change, too.

        Returns:
            True if the kind has changed; False at the first call.
        """
        before, self._last_key = self._last_key, self._build_comparison_key()
        return before not in (None, self._last_key)

    def log(self, logger: Any) -> None:
        """Write `sentence` to a log, with the log level of `level`.

        Each level has a call of its own, since rclpy requires one call site per level.

        Args:
            logger: Logger of the node.
        """
        if self.level is Level.ERROR:
            logger.error(self.sentence)
        elif self.level is Level.WARN:
            logger.warning(self.sentence)
        else:
            logger.info(self.sentence)

    def _build_comparison_key(self) -> tuple[object, ...]:
        """Return the values whose change counts as a change of health.

        Returns:
            Tuple: whether the simulation is halted, phase of the supervision, time of the last stop
            [ns], whether the valves are closed, lost booster modules. Then, for each warning except
            the one on duplicate publishers: whether it was present within the last
            `WARNING_HOLD_NS`. The last element is the text on duplicate publishers.
        """
        arm = self._arm
        phase = arm.supervision.phase
        closed = arm.simulator.valves_closed
        # The text on duplicates counts, since the graph reveals them one after the other.
        *warnings, duplicates = self._list_warnings()
        lost, now_ns = arm.simulator.lost_modules, arm.simulator.time_ns
        self._warned_ns |= {k: now_ns for k, warning in enumerate(warnings) if warning}
        lasting = [
            0 <= now_ns - self._warned_ns.get(k, -WARNING_HOLD_NS) < WARNING_HOLD_NS
            for k in range(len(warnings))
        ]
        return arm.halted, phase, arm.last_stop_ns, closed, lost, *lasting, duplicates

    def _list_warnings(self) -> tuple[str, str, str, str, str, str]:
        """Return all warnings, empty ones included.

        Returns:
            Sentences on six things: a symptom or failed servo pumps, an intervention of the mode
            guard (which changes the plan's modes), the lag of the simulation, the clock offset,
            failed callbacks, and duplicate publishers. A sentence is empty if there is nothing to
            warn of.
        """
        arm, faults = self._arm, self._faults.get_recent_fault()
        return (
            arm.warning,
            arm.intervention,
            self._describe_lag(),
            self._describe_offset(),
            faults,
            self.duplicates,
        )

    def _describe_lag(self) -> str:
        """Return the warning that the simulation lags behind its pace.

        Returns:
            A sentence with the lag [s]; empty if `Pacer.lags` is False.
        """
        if not self._pacer.lags:
            return ""
        return (
            f"the simulation is {self._pacer.lag_ns / SECOND_NS:.2f} s behind its pace, slower "
            "but exact: this machine was too busy for it, or it was frozen"
        )

    def _describe_offset(self) -> str:
        """Return the warning that simulated time differs from the system's time.

        Returns:
            A sentence with the difference [s]. Empty if the difference is at most
            LARGEST_OFFSET_NS, or if the simulator publishes /clock.
        """
        offset_ns = 0 if self._own_clock else time.time_ns() - self._arm.simulator.time_ns
        if abs(offset_ns) <= LARGEST_OFFSET_NS:
            return ""
        side = "behind" if offset_ns > 0 else "ahead of"
        return (
            f"simulated time is {abs(offset_ns) / SECOND_NS:.1f} s {side} the system's clock; go "
            "by the stamps of `reference`, or call ~/reset"
        )
