"""The simulator: MuJoCo mechanics, hydraulic circuit and servo, in lock-step.

In each step of h: servo, half a step of the circuit, a step of the mechanics with the forces of
the pressures there, and the other half of the circuit with the pistons where they have come to:
both are taken at the middle of what the other does, which makes the step's error one of second
order (G. Strang, On the construction and comparison of difference schemes, 1968). Mechanics and
circuit may take several steps in one of the servo.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Any

import mujoco
import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_model.braking import brake_along
from mhsb_model.holding import holding_modes, modes_to_stop
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import ON_RAIL, Mode, assign_modules, modules_in_use, pattern_name, stronger
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray, ModeArray, frozen
from mhsb_sim.bound_kernel import bind
from mhsb_sim.circuit.audit import energy_gap
from mhsb_sim.circuit.network import build_circuit, settle
from mhsb_sim.circuit.quantities import ENERGY, VOLUME
from mhsb_sim.errors import ModeError, SimulationDivergedError
from mhsb_sim.mechanics.mujoco_model import build_model, set_payload
from mhsb_sim.servo import controller_class
from mhsb_sim.servo.controller import REFERENCE_POINTS, SENSOR, ServoSignals
from mhsb_sim.servo.mode_guard import ModeGuard
from mhsb_sim.servo.reference import Reference
from mhsb_sim.simulation.actuator_states import ActuatorStates
from mhsb_sim.simulation.exchange import (
    ANGLE,
    ARM,
    SPEED,
    Believed,
    apply_forces,
    follow,
    measure,
    move_pistons,
    push,
)
from mhsb_sim.simulation.faults import Fault, Plant, set_faults
from mhsb_sim.simulation.plant_check import check_plant
from mhsb_sim.simulation.sensed import Sensed
from mhsb_sim.simulation.sensors import channels_of
from mhsb_sim.simulation.supply_sag import sagging_pressure

NOISE_ROWS = 1000
LARGEST_VALUE = 1e12
YIELD = 1e-3
"""By which an end stop yields to what the arm weighs [rad]."""

REMEMBERED = 4
"""Trajectories, the present one included, of which it is known when they were followed."""


class Simulator:
    """A machine with its servo, at rest in its start posture until it is given a plan.

    machine  what servo, supervision and receiver of plans believe the arm to be
    plant    what is simulated; the same where left out
    guard    what boosts and slows down beyond the plan; a new one after a reset
    lost_modules  booster modules that it does without

    They know of the plant what sensors tell. seed decides the sensor noise; the same seed and the
    same calls give the same bits. posture [rad] replaces the machine's start, payload [kg] the
    plant's. Raises UnknownControllerError, PlantError where both machines do not go together, and
    HoldingError where the start cannot be held.
    """

    _control: Callable[[], None]

    def __init__(
        self,
        machine: Machine,
        controller: str = "coordinated",
        seed: int = 0,
        posture: FloatArray | None = None,
        payload: float | None = None,
        start_ns: int = 0,
        plant: Machine | None = None,
    ) -> None:
        settings = machine.config.simulation
        start = settings.start_posture if posture is None else posture
        self.machine = machine
        self.plant = plant or machine
        check_plant(machine, self.plant)
        self._make_controller = controller_class(controller)
        self._seed = seed
        self._start = frozen(np.array(start, dtype=np.float64))
        self._step_ns = round(settings.step * SECOND_NS)
        self._substeps = self.plant.config.simulation.circuit_substeps
        self._last_substeps = self._substeps // 2
        self._first_substeps = self._substeps - self._last_substeps
        self._sag = self.plant.config.imperfections.supply_sag
        self._inner_steps = self.plant.config.simulation.mechanics_substeps
        self._model = build_model(self.plant)
        self._model.opt.timestep = settings.step / self._inner_steps
        self._payload = self.plant.config.payload.mass
        if payload is not None:
            self.set_payload(payload)
        self.reset(start_ns)

    def reset(self, time_ns: int = 0, posture: FloatArray | None = None) -> None:
        """To rest with all counters at zero at `time_ns`, in the start posture or another [rad].

        Raises HoldingError where that cannot be held.
        """
        loaded = self.plant.changed(payload=self._payload)
        q = self._start if posture is None else self._within_limits(posture)
        modes = holding_modes(loaded, loaded.piston_forces(q))
        self._time_ns = time_ns
        self._steps = 0
        substep = self._model.opt.timestep / self._substeps
        self._circuit = build_circuit(self.plant, substep)
        settle(self._circuit, loaded, q, modes)
        self._believed = build_circuit(self.machine, self.machine.config.simulation.step)
        self._believed.actuators["join"] = self._circuit.actuators["join"]
        self._healthy = self._circuit.constants.copy()
        self.lost_modules: tuple[int, ...] = ()
        self._reset_mechanics(q)
        self._reset_noise()
        self._reset_servo(q, modes)

    def _reset_mechanics(self, q: FloatArray) -> None:
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = q
        linkage, data = self.plant.arrays.linkage, self._data
        n = self.machine.joint_count
        # MuJoCo makes a new view at each access: these are kept.
        position, velocity, control = data.qpos, data.qvel, data.ctrl
        self._pistons = np.empty((4, n))
        joints = linkage, position, velocity, np.full(1, 0.5 * self._model.opt.timestep)
        servo, circuit = self._believed, self._circuit
        believed = Believed(servo.actuators, servo.modules, servo.constants, servo.module_home)
        late = round(self.plant.config.imperfections.computing_delay * SECOND_NS / self._step_ns)
        queue = np.zeros((1 + late, 2 * (n + len(circuit.modules))))
        queue[:, n : 2 * n] = servo.actuators["join"]
        way = believed, queue, np.zeros(1, dtype=np.int64)
        torque = position, velocity, control
        self._push = bind(push, *way, circuit, self._pistons, *torque, integers=2)
        self._follow_pistons = bind(follow, circuit, *joints, self._pistons, integers=1)
        move_pistons(*joints, self._pistons)
        apply_forces(circuit.actuators, circuit.pressure, self._pistons[ARM], *torque)
        mujoco.mj_forward(self._model, data)

    def _reset_noise(self) -> None:
        self._random = np.random.default_rng(self._seed)
        own = np.random.default_rng((self._seed, 1))
        self._channels, self._noise_scale = channels_of(self.plant, own)
        self._noise = np.zeros((NOISE_ROWS, len(self._channels)))

    def _reset_servo(self, q: FloatArray, modes: ModeArray) -> None:
        n = self.machine.joint_count
        circuit, believed = self._circuit, self._believed
        self._signals = ServoSignals(
            reference=np.zeros((REFERENCE_POINTS, 3, n)),
            sensors=np.zeros(n, SENSOR),
            rail_pressure=np.zeros(1),
            modes=modes.copy(),
            modes_ahead=modes.copy(),
            serves=np.full(len(circuit.modules), -1, dtype=np.int64),
            circuit=believed,
        )
        self._measure = bind(
            measure,
            self._noise,
            self._pistons,
            circuit.pressure,
            circuit.modules,
            self._signals.sensors,
            self._signals.rail_pressure,
            believed.modules,
            self._channels,
            np.full(1, 1e-9 * self._step_ns),
            integers=1,
        )
        self._measure(0)
        self._open_valves()
        self._reference = Reference(self._signals.reference, self._controller.preview)
        usual_error = self._controller.usual_error
        self.guard = ModeGuard(self.machine, self._signals, self._reference, usual_error)
        self._watch = self.guard.watch
        self._followed: deque[tuple[int, Trajectory]] = deque(maxlen=REMEMBERED)
        self._hold(q, modes)

    @property
    def time_ns(self) -> int:
        """Simulated time, integer ns."""
        return self._time_ns

    @property
    def plan_time_ns(self) -> int:
        """By which plans are followed [ns]: simulated time less `plan_delay_ns`."""
        return self._reference.own_time_ns(self._time_ns)

    @property
    def plan_delay_ns(self) -> int:
        """By which plans are followed later than they say, because the guard slowed them [ns].

        None where the last one has come to its end: see `catch_up`.
        """
        return 0 if self._reference.rests else self._time_ns - self.plan_time_ns

    def catch_up(self) -> None:
        """Let plans be in time again, where the last one has come to its end."""
        if self._reference.rests:
            self._reference.pace["delay"] = 0.0

    @property
    def step_ns(self) -> int:
        """Length of a step, integer ns."""
        return self._step_ns

    @property
    def payload(self) -> float:
        """At the tip, kg."""
        return self._payload

    @property
    def reference(self) -> MotionState:
        """What the servo follows now."""
        return self._reference.state

    @property
    def planned(self) -> MotionState:
        """What the servo would follow now, were the plan not slowed."""
        return self._reference.at_full_pace(self._time_ns)

    def reference_at(self, time_ns: int) -> MotionState | None:
        """What the servo followed at an earlier time of plans; None where that is forgotten."""
        for since_ns, trajectory in reversed(self._followed):
            if time_ns >= since_ns:
                return trajectory.sample(time_ns)
        return None

    @property
    def joint_state(self) -> MotionState:
        """Measured position, velocity and (of the last step) acceleration of the joints."""
        data = self._data
        position = data.qpos - 0.5 * self._model.opt.timestep * data.qvel  # see `move_pistons`
        return MotionState(position, data.qvel.copy(), data.qacc.copy())

    @property
    def modes(self) -> ModeArray:
        """Modes in force, uint8[n]."""
        return self._in_force.copy()

    @property
    def plan_stamp_ns(self) -> int:
        """Stamp of the plan being executed, 0 while holding or stopping."""
        reference = self._reference
        return reference.trajectory.stamp_ns if reference.executes_plan(self._time_ns) else 0

    @property
    def actuator_states(self) -> ActuatorStates:
        """Pressures, flows and openings now."""
        circuit = self._circuit
        actuators = circuit.actuators
        speed = circuit.modules["flow"] / circuit.constants["servo_pump_flow"]
        return ActuatorStates(
            cap_pressure=circuit.pressure[0:-3:3].copy(),
            rod_pressure=circuit.pressure[1:-3:3].copy(),
            supply_pressure=circuit.pressure[2:-3:3].copy(),
            force=actuators["force"].copy(),
            piston_speed=self._pistons[SPEED].copy(),
            valve_opening=actuators["spool"].copy(),
            valve_command=self._believed.actuators["valve_command"].copy(),
            supply_flow=actuators["supply_flow"].copy(),
            servo_pump_flow=circuit.modules["delivered"].copy(),
            servo_pump_speed=speed,
            servo_pump_command=self._believed.modules["flow_command"]
            / self._believed.constants["servo_pump_flow"],
            rail_pressure=circuit.rail_pressure,
            manifold_pressure=circuit.manifold_pressure,
        )

    def copy_state(
        self,
        reference: FloatArray,
        position: FloatArray,
        pressure: FloatArray,
        modes: ModeArray,
    ) -> None:
        """Write the present state, for runs that keep every step.

        reference float64[3, n] (q, q̇, q̈), position float64[n] rad, pressure float64[3 n + 3] Pa
        in the order of the circuit's nodes, modes uint8[n] in force.
        """
        reference[:] = self._signals.reference[0]
        position[:] = self._pistons[ANGLE]
        pressure[:] = self._circuit.pressure
        modes[:] = self._in_force

    @property
    def spools(self) -> FloatArray:
        """Openings of the valves now, −1 … 1, float64[n]."""
        return self._circuit.actuators["spool"]

    @property
    def sensed(self) -> Sensed:
        """What the servo is told now, and what it asks for."""
        signals, believed = self._signals, self._believed
        sensors = signals.sensors
        return Sensed(
            length=sensors["length"].copy(),
            pressure=np.stack([sensors[f"{each}_pressure"] for each in ("cap", "rod", "line")], 1),
            silent=self._channels["silent"].copy(),
            valve_command=believed.actuators["valve_command"].copy(),
            pump_flow=believed.modules["flow"].copy(),
            pump_command=believed.modules["flow_command"].copy(),
            modes=signals.modes.copy(),
        )

    @property
    def estimates(self) -> list[Estimate]:
        """What the servo has learnt of its machine since the valves opened."""
        return self._controller.estimates

    @property
    def energies(self) -> dict[str, float]:
        """Energies [J] since the start, by name.

        `main_pump`, hydraulic, and `servo_pumps`, at their shafts, are delivered; all others are
        where it went, but for those in `circuit.audit.BESIDE`.
        """
        record = self._circuit.energy[0]
        return {name: float(record[name]) for name in ENERGY.names or ()}

    @property
    def energy_gap(self) -> float:
        """Delivered less accounted for [J]: zero but for rounding."""
        return energy_gap(self.energies)

    @property
    def volumes(self) -> dict[str, float]:
        """Oil volumes [m³] since the start: `main_pump` delivered, all others where it went."""
        record = self._circuit.volume[0]
        return {name: float(record[name]) for name in VOLUME.names or ()}

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        """Follow a trajectory with its mode schedule from now on.

        Raises ModeError where a pattern needs more modules than there are; whether the new
        reference continues the present one is the plan receiver's question.
        """
        self._check_budget(schedule.modes)
        if self.valves_closed:
            self._open_valves()
        self._follow(trajectory, schedule, planned=True)

    def stop(self) -> None:
        """Decelerate along the path of the plan in force, then hold; no effect without a plan."""
        now = self.plan_time_ns
        if not self._reference.executes_plan(self._time_ns):
            return
        braking = brake_along(self.machine, self._reference.trajectory, now)
        rows = np.unique([0, braking.duration_ns])
        modes = [self._signals.modes.copy(), self._modes_to_hold(braking.position[-1])]
        self._follow(braking, ModeSchedule(now, rows, np.array(modes[-len(rows) :])))

    def close_valves(self) -> None:
        """Shut all valves, the isolating ones too, and stop the servo pumps until the next plan, or
        a reset."""
        actuators, modules = self._believed.actuators, self._believed.modules
        actuators["valve_command"] = actuators["join_command"] = 0.0
        modules["flow_command"] = modules["lend"] = 0.0
        self._circuit.actuators["isolating_command"] = 1.0  # hard-wired, without the servo's delay
        self.guard.forget()
        self._prepare_modes()
        self._control = _leave_commands

    @property
    def valves_closed(self) -> bool:
        """Whether all valves are shut, and the servo has no say."""
        return self._control is _leave_commands

    def vent(self, drop: float) -> bool:
        """Let oil that closed valves have trapped down by `drop` [Pa]; whether none is trapped.

        Trapped is what no holding needs: above the mean of supply and tank both chambers, where a
        servo would find flows reversed; and any that presses a joint against its end stop. The
        relief valves let it go; they are set back when the valves open.
        """
        arrays, actuators = self.machine.arrays, self._circuit.actuators
        chambers = self._circuit.pressure[:-3].reshape(-1, 3)[:, :2] - arrays.tank_pressure
        lower, higher = chambers.min(axis=1), chambers.max(axis=1)
        trapped = lower > 0.5 * (arrays.supply_pressure - arrays.tank_pressure)
        beyond = np.abs(self._data.qpos - self._within_limits(self._data.qpos))
        trapped |= (beyond > YIELD) & (higher > drop)
        actuators["relief"][trapped] = higher[trapped] - drop
        return not trapped.any()

    def hold_here(self) -> None:
        """Hold the measured posture, within the joint limits, from now on: the reference steps."""
        q = self._within_limits(self._pistons[ANGLE])
        self._reference.pace["delay"] = 0.0
        self._hold(q, self._modes_to_hold(q))

    def set_payload(self, mass: float) -> None:
        """Change the payload [kg] on the tip; the servo is not told."""
        self._payload = mass
        set_payload(self._model, mass)

    def silence_noise(self) -> None:
        """Let sensors tell without noise from now on; what else they have stays."""
        self._noise_scale[:] = 0.0
        self._noise[:] = 0.0

    def inject(self, faults: Sequence[Fault]) -> None:
        """Let these fail from now on and nothing else; a reset heals all."""
        set_faults(faults, Plant(self._circuit, self._channels), self._healthy)

    def lose_modules(self, lost: Collection[int]) -> None:
        """Do without these booster modules from now on, the first being 0."""
        self.lost_modules = tuple(sorted(lost))
        self._prepare_modes()

    def advance(self, duration: float) -> None:
        """Run for `duration` [s], rounded to whole steps."""
        for _ in range(round(duration * SECOND_NS / self._step_ns)):
            self.step()

    def step(self) -> None:
        """Advance by one step; raises SimulationDivergedError where the state is not finite."""
        if self._sag is not None:
            time = self._steps * self._step_ns / SECOND_NS
            pressure = sagging_pressure(self.plant.arrays.supply_pressure, self._sag, time)
            self._circuit.constants["supply_pressure"] = pressure
        self._control_valves()
        for inner in range(self._inner_steps):
            mujoco.mj_step1(self._model, self._data)
            if not self._push(inner == 0, self._first_substeps):
                raise self._diverged()
            mujoco.mj_step2(self._model, self._data)
            self._follow_pistons(self._last_substeps)
        self._steps += 1
        self._time_ns += self._step_ns
        self._update_reference()

    def step_hydraulics(self) -> None:
        """The part of a step that is sensors, servo and circuit; the arm stays where it is."""
        self._control_valves()
        self._push(True, self._first_substeps)
        self._follow_pistons(self._last_substeps)

    def _control_valves(self) -> None:
        """Sensors, and the servo's commands on their way."""
        row = self._steps % NOISE_ROWS
        if row == 0:
            self._random.standard_normal(out=self._noise)
            self._noise *= self._noise_scale
        self._measure(row)
        if not self.valves_closed and self._watch():
            self._prepare_modes()
        self._control()

    def _open_valves(self) -> None:
        """Let the servo act, a new one that remembers nothing."""
        self._circuit.actuators["relief"] = self.plant.chamber_reliefs
        self._circuit.actuators["isolating_command"] = 0.0
        self._controller = self._make_controller(self.machine, self._signals)
        self._control = self._controller.update

    def _within_limits(self, q: FloatArray) -> FloatArray:
        return np.clip(q, self.machine.arrays.joint_min, self.machine.arrays.joint_max)

    def _hold(self, q: FloatArray, modes: ModeArray) -> None:
        now = self.plan_time_ns
        schedule = ModeSchedule(now, np.zeros(1, dtype=np.int64), np.atleast_2d(modes))
        self._follow(standstill(q, now), schedule)

    def _follow(
        self, trajectory: Trajectory, schedule: ModeSchedule, *, planned: bool = False
    ) -> None:
        self._followed.append((self.plan_time_ns, trajectory))
        self._reference.follow(trajectory, schedule, planned=planned)
        self._update_reference()

    def _update_reference(self) -> None:
        if self._reference.update(self._time_ns):
            self._prepare_modes()

    def _prepare_modes(self) -> None:
        """Boost of the modes ahead comes early, as far as modules are free.

        But nobody joins the rail early, where its pressure would reach one who is about to leave:
        the line is charged by its own pump until then.
        """
        modules, lost = self.machine.config.hydraulics.modules, self.lost_modules
        planned, planned_ahead = self._reference.modes, self._reference.modes_ahead
        count = modules.count - len(lost)
        now, ahead = (self.guard.modes(each, count) for each in (planned, planned_ahead))
        self.guard.note(planned, stronger(planned, planned_ahead), now)
        self._in_force = now
        prepared = stronger(now, ahead)
        if np.any(ON_RAIL[now] & ~ON_RAIL[ahead]):
            prepared[~ON_RAIL[now] & ON_RAIL[ahead]] = Mode.DB
        if modules_in_use(prepared, modules.per_mode) > count:
            prepared = now
        self._signals.modes[:] = prepared
        self._signals.modes_ahead[:] = ahead
        self._signals.serves[:] = assign_modules(prepared, modules.count, modules.per_mode, lost)

    def _modes_to_hold(self, q: FloatArray) -> ModeArray:
        """Modes in which to come to rest at q [rad]."""
        return modes_to_stop(self.machine, self.machine.piston_forces(q), self._reference.modes)

    def _check_budget(self, patterns: ModeArray) -> None:
        modules = self.machine.config.hydraulics.modules
        for pattern in patterns:
            needed = modules_in_use(pattern, modules.per_mode)
            if needed > modules.count:
                raise ModeError(
                    f"the mode pattern {pattern_name(pattern)} needs {needed} booster modules, "
                    f"{modules.count} are fitted"
                )

    def _diverged(self) -> SimulationDivergedError:
        """The error that names what is not finite, causes before effects."""
        candidates: list[tuple[str, Any]] = [
            ("the joint position", self._data.qpos),
            ("the joint velocity", self._data.qvel),
            ("the reference", self._signals.reference),
            ("a pressure", self._circuit.pressure),
            ("the servo's valve command", self._believed.actuators["valve_command"]),
            ("the servo's pump command", self._believed.modules["flow_command"]),
        ]
        for text, values in candidates:
            if not np.all(np.isfinite(values)) or np.any(np.abs(values) > LARGEST_VALUE):
                quantity = text.replace("_", " ")
                break
        else:
            quantity = "the joint motion"
        return SimulationDivergedError(quantity, self._time_ns / SECOND_NS)


def _leave_commands() -> None:
    """What stands in for the servo while valves are closed."""
