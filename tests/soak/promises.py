"""List of all promises that the suite keeps under any disturbance.

Each promise is judged by the messages on public topics, by output and memory of the processes, and
by the actions of the soak.
"""

from __future__ import annotations

from collections.abc import Callable

from tests.soak import goal_promises, motion_promises, process_promises
from tests.soak.events import Events
from tests.soak.kept import PromiseResult

PROMISES: dict[str, Callable[[Events], PromiseResult]] = {
    "every goal gets exactly one verdict": goal_promises.check_one_verdict,
    "every accepted goal's execution ends exactly once": goal_promises.check_one_execution_report,
    "no undisturbed goal is lost": goal_promises.check_no_goal_lost,
    "of every plan the arm tells exactly once what became of it": (
        goal_promises.check_one_hand_over_report
    ),
    "stamps of plans increase": goal_promises.check_stamps_increase,
    "while the arm reports a fault, goals are refused as FAULT": (
        goal_promises.check_refused_at_faults
    ),
    "no plan makes the reference jump": motion_promises.check_hand_over_jumps,
    "the reference is continuous": motion_promises.check_continuous_reference,
    "the reference is the plan in force": motion_promises.check_reference_is_plan,
    "joint limits are kept": motion_promises.check_joint_limits,
    "V_max and the main pump's flow are kept": motion_promises.check_speed_limits,
    "zones are kept out of": motion_promises.check_zones,
    "after a stop nothing moves until the next goal": motion_promises.check_rest_after_stops,
    "after healing nothing lunges": motion_promises.check_healing,
    "strange settings are refused": process_promises.check_invalid_settings_refused,
    "no process ends by itself": process_promises.check_no_process_ends,
    "a planner that is ready answers": process_promises.check_starts,
    "no process prints a traceback": process_promises.check_no_tracebacks,
    "processes end within 2 s when asked": process_promises.check_clean_ends,
    "what memory is kept stays within 5 MB after four minutes": (
        process_promises.check_memory_growth
    ),
}
"""Function that checks each promise, by the promise in words."""
