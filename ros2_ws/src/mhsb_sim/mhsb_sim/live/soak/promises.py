"""What the suite promises whatever is done to it: the whole list.

Each promise is judged by what anybody on the topics can hear, by output and memory of the
processes, and by what the soak did.
"""

from __future__ import annotations

from collections.abc import Callable

from mhsb_sim.live.soak import goal_promises, motion_promises, process_promises
from mhsb_sim.live.soak.events import Events
from mhsb_sim.live.soak.kept import Kept

PROMISES: dict[str, Callable[[Events], Kept]] = {
    "every goal gets exactly one verdict": goal_promises.one_verdict,
    "every accepted goal's execution ends exactly once": goal_promises.one_ending,
    "no undisturbed goal is lost": goal_promises.none_lost,
    "of every plan the arm tells exactly once what became of it": goal_promises.told_once,
    "stamps of plans increase": goal_promises.stamps_increase,
    "while the arm reports a fault, goals are refused as FAULT": goal_promises.refused_at_faults,
    "no plan makes the reference jump": motion_promises.small_jumps,
    "the reference is continuous": motion_promises.continuous_reference,
    "the reference is the plan in force": motion_promises.follows_the_plan,
    "joint limits are kept": motion_promises.within_joint_limits,
    "V_max and the main pump's flow are kept": motion_promises.within_speed_limits,
    "zones are kept out of": motion_promises.keeps_out,
    "after a stop nothing moves until the next goal": motion_promises.rests_after_stops,
    "after healing nothing lunges": motion_promises.heals_gently,
    "no process ends by itself": process_promises.nobody_dies,
    "no process prints a traceback": process_promises.no_tracebacks,
    "processes end within 2 s when asked": process_promises.clean_ends,
    "what memory is kept stays within 5 MB after three minutes": process_promises.memory_is_flat,
}
