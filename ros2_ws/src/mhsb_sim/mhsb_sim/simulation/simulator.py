"""The simulator: MuJoCo mechanics, hydraulic circuit and servo, in lock-step.

A step of length h consists of four parts:

1. the servo,
2. half a step of the circuit,
3. a step of the mechanics with the forces of the pressures at that time,
4. the other half of the circuit, with the new piston positions.

So the mechanics are evaluated in the middle of the circuit's step, and the circuit in the middle of
the mechanics' step. This makes the method of second order (G. Strang, On the construction and
comparison of difference schemes, 1968). Mechanics and circuit may take several steps in one step of
the servo.
"""

from collections import deque
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mhsb_control import default_controller, measures_pressures
from mhsb_control.controller import LearningController, ServoSignals
from mhsb_control.estimates_file import read_estimates_file, write_estimates_file
from mhsb_control.registry import check_keeps_estimates
from mhsb_control.servo_loop import ServoLoop
from mhsb_model.arm_reports import Estimate
from mhsb_model.braking import brake_along
from mhsb_model.circuit.components import describe_components
from mhsb_model.holding import choose_holding_modes, choose_stop_modes
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray, ModeArray, frozen
from mhsb_sim.circuit.network import build_circuit, set_rest_pressures
from mhsb_sim.errors import ModeError, SimulationDivergedError
from mhsb_sim.mechanics.mujoco_model import build_model, set_payload
from mhsb_sim.simulation.exchange import (
    ANGLE_ROW,
    LARGEST_STATE,
    MOMENT_ARM_ROW,
    SPEED_ROW,
    CommandQueue,
    JointDrive,
    SensedPlant,
    SensorReadings,
    advance_to_midstep,
    advance_to_step_end,
    apply_forces,
    move_pistons,
    read_sensors,
)
from mhsb_sim.simulation.faults import Fault, FaultTarget, compute_sag_pressure, set_faults
from mhsb_sim.simulation.plan_receiver import find_schedule_problem
from mhsb_sim.simulation.plant_files import check_plant
from mhsb_sim.simulation.sensors import ActuatorStates, Sensed, build_channels

NOISE_ROWS = 1000
"""Number of steps for which sensor noise is drawn at once."""
LARGEST_VALUE = 1e12
"""Values beyond this count as not finite."""
END_STOP_DEFLECTION = 1e-3
"""Distance by which an end stop yields under the arm's weight [rad or m]."""

PRESSURE_COLUMNS = ("cap", "rod", "line")
"""Pressures of an actuator in the order of their sensors."""

TRAJECTORY_CAPACITY = 4
"""Number of trajectories that have recorded times, the present one included."""


class Simulator:
    """A machine with its servo, at rest in its start posture until it is given a plan.

    The servo knows the plant only by its sensors. Supervision also uses true joint positions and
    pressures. The same seed and the same calls give the same bits.

    Attributes:
        machine: Machine that servo, supervision and plan receiver assume.
        plant: Machine that is simulated.
        controller_name: Name of the servo controller.
        step_ns: Length of a step [ns].
        guard: Mode guard, which boosts actuators and slows the plan; a new one after a reset.
    """

    _control: Callable[[], None]

    def __init__(
        self,
        machine: Machine,
        controller: str | None = None,
        seed: int = 0,
        posture: FloatArray | None = None,
        payload: float | None = None,
        start_ns: int = 0,
        plant: Machine | None = None,
        estimates_file: Path | None = None,
    ) -> None:
        """Build the simulation of a machine, at rest in its start posture.

        Args:
            machine: Machine that servo, supervision and plan receiver assume.
            controller: Name of the servo controller; None for the default of the machine's
                sensors (`mhsb_control.default_controller`).
            seed: Seed of the sensor noise.
            posture: Joint positions at the start, float64[n], [rad or m]; None for the posture in
                the machine file.
            payload: Payload of the plant [kg]; None for the one in the plant's file.
            start_ns: Simulated time at the start [ns].
            plant: Machine that is simulated; None for `machine`.
            estimates_file: File with the estimates that the servo learnt earlier; the servo begins
                with them. The file need not exist yet; `save_estimates` writes it. None for a servo
                that begins without estimates.

        Raises:
            EstimatesFileError: The estimates file is damaged or belongs to another machine.
            ArgumentError: An estimates file is given, but the controller does not learn.
            UnknownControllerError: No controller has this name.
            MachineFileError: The controller's gains in the machine's file, or the sections of
                valves in the plant's file, are wrong.
            PressureSensorsError: The controller reads pressures that the machine does not measure.
            PlantError: Machine and plant have different numbers of joints or modules.
            HoldingError: The arm cannot be held in the start posture.
        """
        settings = machine.config.simulation
        start = settings.start_posture if posture is None else posture
        self.machine = machine
        self.plant = plant or machine
        check_plant(machine, self.plant)
        self.controller_name = controller or default_controller(machine)
        self._estimates_file, self._learnt = estimates_file, None
        if estimates_file is not None:
            check_keeps_estimates(self.controller_name)
            self._learnt = read_estimates_file(estimates_file, machine)
        self._seed = seed
        self._start = frozen(np.array(start, dtype=np.float64))
        self.step_ns = round(settings.step * SECOND_NS)
        rate = self.plant.config.imperfections.sensors.rate
        self._sensor_steps = max(round(1.0 / (rate * settings.step)), 1) if rate else 1
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
        """Put the arm at rest, with all counters at zero and without faults.

        The payload does not change. The servo begins with the estimates that `save_estimates`
        stored last. The arm holds its posture in modes that carry its load. The random numbers of
        the sensors start again from the seed.

        Args:
            time_ns: New simulated time [ns].
            posture: Joint positions, float64[n], [rad or m], clipped to the joint limits. None for
                the start posture.

        Raises:
            HoldingError: The arm cannot be held in that posture.
        """
        loaded = self.plant.changed(payload=self._payload)
        q = self._start if posture is None else self._clip_to_limits(posture)
        modes = choose_holding_modes(loaded, loaded.piston_forces(q))
        self._time_ns = time_ns
        self._steps = 0
        substep = self._model.opt.timestep / self._substeps
        self._circuit = build_circuit(self.plant, substep)
        set_rest_pressures(self._circuit, loaded, q, modes)
        self._servo_circuit = describe_components(self.machine, self.machine.config.simulation.step)
        self._servo_circuit.actuators["join"] = self._circuit.actuators["join"]
        self._healthy = self._circuit.constants.copy()
        self._kept_pressure = float(self._healthy["supply_pressure"][0])
        self._reset_mechanics(q)
        self._reset_noise()
        self._reset_servo(q, modes)

    def _reset_mechanics(self, q: FloatArray) -> None:
        """Build the mechanical state at rest in a posture, and bind the kernels of a step to it.

        The queue of the servo's commands is created, too. It delays the commands by the plant's
        computing delay, rounded to whole steps.

        Args:
            q: Joint positions, float64[n], [rad or m].
        """
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = q
        linkage, data = self.plant.arrays.linkage, self._data
        n = self.machine.joint_count
        # MuJoCo creates a new view at each access; the kernels are bound to these views.
        position, velocity, control = data.qpos, data.qvel, data.ctrl
        self._pistons = np.empty((4, n))
        joints = linkage, position, velocity, np.full(1, 0.5 * self._model.opt.timestep)
        servo, circuit = self._servo_circuit, self._circuit
        late = round(self.plant.config.imperfections.computing_delay * SECOND_NS / self.step_ns)
        rows = np.zeros((1 + late, 2 * (n + len(circuit.modules))))
        rows[:, n : 2 * n] = servo.actuators["join"]
        queue = CommandQueue(rows, np.zeros(1, dtype=np.int64))
        drive = JointDrive(position, velocity, control)
        self._push = bind_kernel(
            advance_to_midstep, servo, queue, circuit, self._pistons, drive, integer_count=2
        )
        self._follow_pistons = bind_kernel(
            advance_to_step_end, circuit, *joints, self._pistons, integer_count=1
        )
        move_pistons(*joints, self._pistons)
        apply_forces(circuit.actuators, circuit.pressure, self._pistons[MOMENT_ARM_ROW], drive)
        mujoco.mj_forward(self._model, data)

    def _reset_noise(self) -> None:
        """Start the random numbers from the seed, and draw offsets and drifts of the sensors."""
        self._random = np.random.default_rng(self._seed)
        own = np.random.default_rng((self._seed, 1))
        self._channels, self._noise_scale = build_channels(self.plant, own, self._sensor_period)
        self._noise = np.zeros((NOISE_ROWS, len(self._channels)))

    @property
    def _sensor_period(self) -> float:
        """Time from one reading of the sensors to the next [s]."""
        return self._sensor_steps * self.step_ns / SECOND_NS

    def _reset_servo(self, q: FloatArray, modes: ModeArray) -> None:
        """Build the sensors and the servo, open the valves, and hold a posture.

        Without pressure sensors, the servo gets the constant pressures of `ServoSignals.at_rest`.

        Args:
            q: Joint positions to be held, float64[n], [rad or m].
            modes: Modes in which the posture is held, uint8[n].
        """
        circuit, servo_circuit = self._circuit, self._servo_circuit
        self._signals = ServoSignals.at_rest(servo_circuit, modes)
        measured = circuit.pressure
        if not measures_pressures(self.plant):
            assumed = [self._signals.sensors[f"{each}_pressure"] for each in PRESSURE_COLUMNS]
            measured = np.append(np.stack(assumed, 1), self._signals.rail_pressure)
        self._measure = bind_kernel(
            read_sensors,
            self._noise,
            SensedPlant(self._pistons, measured, circuit.modules),
            SensorReadings(
                self._signals.sensors, self._signals.rail_pressure, servo_circuit.modules
            ),
            self._channels,
            np.full(1, self._sensor_period),
            integer_count=1,
        )
        self._measure(0)
        self._reading_ns = self._time_ns
        self._servo = ServoLoop(self.controller_name, self.machine, self._signals, self._learnt)
        self._reference, self.guard = self._servo.reference, self._servo.guard
        self._open_valves()
        self._followed: deque[tuple[int, Trajectory]] = deque(maxlen=TRAJECTORY_CAPACITY)
        self._hold(q, modes)

    @property
    def time_ns(self) -> int:
        """Simulated time [ns]."""
        return self._time_ns

    @property
    def plan_time_ns(self) -> int:
        """Time of plans [ns]: simulated time minus the delay that speed scaling has caused."""
        return self._reference.compute_trajectory_time_ns(self._time_ns)

    @property
    def plan_delay_ns(self) -> int:
        """Delay of plans that speed scaling has caused [ns]; 0 if the last plan has ended."""
        return 0 if self._reference.has_ended else self._time_ns - self.plan_time_ns

    def catch_up(self) -> None:
        """Set the delay that speed scaling has caused to 0 if the last plan has ended."""
        if self._reference.has_ended:
            self._reference.speed_scaling["delay"] = 0.0

    @property
    def payload(self) -> float:
        """Payload at the tip of the plant [kg]."""
        return self._payload

    @property
    def reference(self) -> MotionState:
        """Present reference of the servo."""
        return self._reference.state

    @property
    def planned(self) -> MotionState:
        """State of the plan at the present reference position.

        Velocity and acceleration are those at full speed: speed scaling does not reduce them.
        """
        return self._reference.sample_at_full_speed(self._time_ns)

    def reference_at(self, time_ns: int) -> MotionState | None:
        """Return the reference at an earlier time.

        Args:
            time_ns: Time of plans [ns]: simulated time minus the delay that speed scaling has
                caused.

        Returns:
            State of the trajectory that was followed then; None if it is no longer recorded.
        """
        for since_ns, trajectory in reversed(self._followed):
            if time_ns >= since_ns:
                return trajectory.sample(time_ns)
        return None

    @property
    def joint_state(self) -> MotionState:
        """True position and velocity of the joints now, and their accelerations in the last step.

        Sensor errors are not included.
        """
        data = self._data
        position = data.qpos - 0.5 * self._model.opt.timestep * data.qvel  # see `move_pistons`
        return MotionState(position, data.qvel.copy(), data.qacc.copy())

    @property
    def modes(self) -> ModeArray:
        """Modes in force, uint8[n]."""
        return self._servo.modes.copy()

    @property
    def lost_modules(self) -> tuple[int, ...]:
        """Indices, from 0, of booster modules that have failed and are not used."""
        return self._servo.lost_modules

    @property
    def plan_stamp_ns(self) -> int:
        """Stamp of the plan that is being executed [ns]; 0 while holding or stopping."""
        reference = self._reference
        return reference.trajectory.stamp_ns if reference.executes_plan(self._time_ns) else 0

    @property
    def actuator_states(self) -> ActuatorStates:
        """Present states of the actuators and pumps in the simulated circuit.

        They are true values without sensor errors: pressures, flows, piston forces and speeds,
        valve openings and pump speeds. The commands of valves and servo pumps are the newest ones
        of the servo, before its computing delay.
        """
        circuit = self._circuit
        actuators = circuit.actuators
        speed = circuit.modules["flow"] / circuit.constants["servo_pump_flow"]
        return ActuatorStates(
            cap_pressure=circuit.pressure[0:-3:3].copy(),
            rod_pressure=circuit.pressure[1:-3:3].copy(),
            supply_pressure=circuit.pressure[2:-3:3].copy(),
            force=actuators["force"].copy(),
            piston_speed=self._pistons[SPEED_ROW].copy(),
            valve_opening=actuators["spool"].copy(),
            valve_command=self._servo_circuit.actuators["valve_command"].copy(),
            supply_flow=actuators["supply_flow"].copy(),
            servo_pump_flow=circuit.modules["delivered"].copy(),
            servo_pump_speed=speed,
            servo_pump_command=self._servo_circuit.modules["flow_command"]
            / self._servo_circuit.constants["servo_pump_flow"],
            rail_pressure=circuit.rail_pressure,
            manifold_pressure=circuit.manifold_pressure,
        )

    def write_state(
        self,
        reference: FloatArray,
        position: FloatArray,
        pressure: FloatArray,
        modes: ModeArray,
    ) -> None:
        """Copy the present state into arrays, for recordings that keep every step.

        All arrays are written in place.

        Args:
            reference: Rows for position, velocity and acceleration of the reference, float64[3, n].
            position: True joint positions, float64[n], [rad or m].
            pressure: Pressures of all nodes, float64[3 n + 3], [Pa]: cap side, rod side and line of
                each actuator in turn, and then rail, manifold (behind the main pump) and tank.
            modes: Modes in force, uint8[n].
        """
        reference[:] = self._signals.reference[0]
        position[:] = self._pistons[ANGLE_ROW]
        pressure[:] = self._circuit.pressure
        modes[:] = self._servo.modes

    @property
    def spools(self) -> FloatArray:
        """Present openings of the valves, −1 … 1, float64[n]; a view of the circuit's state."""
        return self._circuit.actuators["spool"]

    @property
    def sensed(self) -> Sensed:
        """Present sensor readings and commands of the servo, as copies."""
        signals, servo_circuit = self._signals, self._servo_circuit
        sensors = signals.sensors
        return Sensed(
            reading_ns=self._reading_ns,
            length=sensors["length"].copy(),
            length_noise=self._noise_scale[: len(sensors)].copy(),
            pressure=np.stack([sensors[f"{each}_pressure"] for each in PRESSURE_COLUMNS], 1),
            silent=self._channels["silent"].copy(),
            valve_command=servo_circuit.actuators["valve_command"].copy(),
            pump_flow=servo_circuit.modules["flow"].copy(),
            pump_command=servo_circuit.modules["flow_command"].copy(),
            modes=signals.modes.copy(),
        )

    @property
    def estimates(self) -> list[Estimate]:
        """Estimates of the present controller, which `restart_servo` replaces by a new one."""
        return self._servo.controller.estimates

    def save_estimates(self) -> None:
        """Store what the servo has learnt, and write it into the estimates file if one was given.

        The servo begins with the stored estimates after a reset, and when its valves open again.
        Nothing happens if the controller learns nothing that can be kept.

        Raises:
            EstimatesFileError: The file cannot be written. The estimates are stored nevertheless.
        """
        controller = self._servo.controller
        if isinstance(controller, LearningController):
            self._learnt = controller.get_learnt()
            if self._estimates_file is not None:
                write_estimates_file(self._estimates_file, self.machine, self._learnt)

    @property
    def energies(self) -> dict[str, float]:
        """Energies since the start by name [J].

        `main_pump` (hydraulic) and `servo_pumps` (at the shafts) are the delivered energies. The
        other entries say where this energy went, and their sum is equal to it. Two entries do not
        belong to the sum (`UNBALANCED_ENERGIES`): `friction` is part of `piston_work`, and
        `main_pump_shaft` includes `main_pump`.
        """
        energy = self._circuit.energy
        return {name: float(energy[name][0]) for name in energy.dtype.names or ()}

    @property
    def volumes(self) -> dict[str, float]:
        """Oil volumes since the start by name [m³].

        `main_pump` is the delivered volume. The other entries say where this oil went, and their
        sum is equal to it.
        """
        volume = self._circuit.volume
        return {name: float(volume[name][0]) for name in volume.dtype.names or ()}

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        """Follow a plan from now on, and open the valves if they are closed.

        The caller must make sure that the plan continues the present reference. If the valves were
        closed, the servo starts again, with the estimates of the latest call of `save_estimates`.

        Args:
            trajectory: Trajectory of the plan.
            schedule: Mode schedule of the plan.

        Raises:
            ModeError: The schedule has another number of actuators than the machine, or a mode
                combination needs more booster modules than there are.
        """
        if problem := find_schedule_problem(self.machine, schedule):
            raise ModeError(problem)
        if self.valves_closed:
            self.restart_servo()
            self._open_valves()
        self._follow(trajectory, schedule, planned=True)

    def stop(self) -> None:
        """Decelerate along the path of the plan in force, then hold; no effect without a plan.

        While the arm decelerates, the modes do not change. Each actuator has its prepared mode: the
        mode in force, or a boosted mode that was to begin before the preview point. At rest, the
        arm gets modes that hold its load there, if there are enough booster modules for them.
        """
        now = self.plan_time_ns
        if not self._reference.executes_plan(self._time_ns):
            return
        braking = brake_along(self.machine, self._reference.trajectory, now)
        rows = np.unique([0, braking.duration_ns])
        modes = [self._signals.modes.copy(), self._choose_holding_modes(braking.position[-1])]
        self._follow(braking, ModeSchedule(now, rows, np.array(modes[-len(rows) :])))

    def close_valves(self) -> None:
        """Shut all valves and stop the servo pumps, until the next plan or a reset.

        The servo's commands become 0, and the servo does not run. The valves that isolate the
        chambers close, too. They close without the servo's computing delay. The mode guard, which
        boosts actuators beyond the plan, drops its requests.
        """
        actuators, modules = self._servo_circuit.actuators, self._servo_circuit.modules
        actuators["valve_command"] = actuators["join_command"] = 0.0
        modules["flow_command"] = modules["to_rail_command"] = 0.0
        self._circuit.actuators["isolating_command"] = 1.0  # hard-wired, without the servo's delay
        self.guard.reset()
        self._servo.prepare_modes()
        self._control = _keep_commands

    def restart_servo(self) -> None:
        """Let the servo start again, with the estimates of the latest call of `save_estimates`.

        Reference, modes and valves do not change. What the servo has learnt since is forgotten.
        """
        self._servo.restart(self._learnt)

    @property
    def valves_closed(self) -> bool:
        """True if all valves are shut and the servo does not act."""
        return self._control is _keep_commands

    def lower_trapped_pressure(self, drop: float) -> bool:
        """Let relief valves lower the pressure of oil that is trapped behind closed valves.

        The oil of an actuator is trapped in two cases:

        - The pressures of both chambers exceed the mean of supply and tank pressure. If the valve
          opened, oil would flow back.
        - The joint is pressed against its end stop, and its higher chamber pressure exceeds `drop`.

        The relief valves of this actuator are then set below its higher chamber pressure, by
        `drop`. Those of all other actuators have the plant's settings, so that no load sinks
        through them.

        Args:
            drop: Difference between the higher chamber pressure and the setting [Pa].

        Returns:
            True if no oil is trapped.
        """
        arrays, actuators = self.machine.arrays, self._circuit.actuators
        chambers = self._circuit.pressure[:-3].reshape(-1, 3)[:, :2] - arrays.tank_pressure
        lower, higher = chambers.min(axis=1), chambers.max(axis=1)
        trapped = lower > 0.5 * (arrays.supply_pressure - arrays.tank_pressure)
        beyond = np.abs(self._data.qpos - self._clip_to_limits(self._data.qpos))
        trapped |= (beyond > END_STOP_DEFLECTION) & (higher > drop)
        actuators["relief"] = np.where(trapped, higher - drop, self.plant.chamber_reliefs)
        return not trapped.any()

    def hold_here(self) -> None:
        """Hold the arm's present posture from now on, clipped to the joint limits.

        The reference jumps to the true (simulated) posture, and the delay of plans becomes 0.
        """
        q = self._clip_to_limits(self._pistons[ANGLE_ROW])
        self._reference.speed_scaling["delay"] = 0.0
        self._hold(q, self._choose_holding_modes(q))

    def set_payload(self, mass: float) -> None:
        """Change the payload of the plant at once; the servo is not informed.

        Args:
            mass: Payload at the tip [kg].
        """
        self._payload = mass
        set_payload(self._model, mass)

    def disable_noise(self) -> None:
        """Switch off the noise of all sensors until a reset; offsets, drifts and rounding stay."""
        self._noise_scale[:] = 0.0
        self._noise[:] = 0.0

    def inject_faults(self, faults: Sequence[Fault]) -> None:
        """Inject faults, and end all other faults; a reset ends all faults.

        Args:
            faults: All faults that are to exist from now on.
        """
        set_faults(faults, FaultTarget(self._circuit, self._channels), self._healthy)
        self._kept_pressure = float(self._circuit.constants["supply_pressure"][0])

    def disable_modules(self, lost: Collection[int]) -> None:
        """Stop using some booster modules from now on, and use all others again.

        Args:
            lost: Indices, from 0, of the modules that are no longer used.
        """
        self._servo.lost_modules = tuple(sorted(lost))
        self._servo.prepare_modes()

    def advance(self, duration: float) -> None:
        """Run for a duration, rounded to whole steps.

        Args:
            duration: Simulated time [s].

        Raises:
            SimulationDivergedError: The state is no longer finite, or far too large.
        """
        for _ in range(round(duration * SECOND_NS / self.step_ns)):
            self.step()

    def step(self) -> None:
        """Advance by one step of the servo, with all its steps of circuit and mechanics.

        If the plant has a supply sag, the main pump's pressure is set for this step first. If a
        fault has lowered that pressure, the lower of both pressures counts.

        Raises:
            SimulationDivergedError: The state is no longer finite, or far too large.
        """
        if self._sag is not None:
            time = self._steps * self.step_ns / SECOND_NS
            pressure = compute_sag_pressure(self.plant.arrays.supply_pressure, self._sag, time)
            self._circuit.constants["supply_pressure"] = min(pressure, self._kept_pressure)
        self._control_valves()
        for inner in range(self._inner_steps):
            mujoco.mj_step1(self._model, self._data)
            if not self._push(inner == 0, self._first_substeps):
                raise self._build_divergence_error()
            mujoco.mj_step2(self._model, self._data)
            self._follow_pistons(self._last_substeps)
        self._steps += 1
        self._time_ns += self.step_ns
        self._servo.update_reference(self._time_ns)

    def _control_valves(self) -> None:
        """Read the sensors and run the servo.

        Noise is drawn for NOISE_ROWS steps at once. Sensors that are slower than the servo keep
        their readings for several steps. While the valves are closed, only the sensors are read.
        The servo's commands then do not change, and the mode guard does nothing.
        """
        row = self._steps % NOISE_ROWS
        if row == 0:
            self._random.standard_normal(out=self._noise)
            self._noise *= self._noise_scale
        if self._steps % self._sensor_steps == 0:
            self._measure(row)
            self._reading_ns = self._time_ns
        self._control()

    def _open_valves(self) -> None:
        """Let the servo act again, and open the valves that isolate the chambers.

        The relief pressures of the chambers are restored.
        """
        self._circuit.actuators["relief"] = self.plant.chamber_reliefs
        self._circuit.actuators["isolating_command"] = 0.0
        self._control = self._servo.step

    def _clip_to_limits(self, q: FloatArray) -> FloatArray:
        """Return joint positions clipped to the joint limits, float64[n], [rad or m]."""
        return np.clip(q, self.machine.arrays.joint_min, self.machine.arrays.joint_max)

    def _hold(self, q: FloatArray, modes: ModeArray) -> None:
        """Hold a posture from now on.

        Args:
            q: Joint positions, float64[n], [rad or m].
            modes: Mode of each actuator, uint8[n].
        """
        now = self.plan_time_ns
        schedule = ModeSchedule(now, np.zeros(1, dtype=np.int64), np.atleast_2d(modes))
        self._follow(standstill(q, now), schedule)

    def _follow(
        self, trajectory: Trajectory, schedule: ModeSchedule, *, planned: bool = False
    ) -> None:
        """Follow a trajectory from now on, and update reference and modes at once.

        The time at which the trajectory begins to be followed is recorded for `reference_at`. It is
        a time of plans: simulated time minus the delay that speed scaling has caused.

        Args:
            trajectory: The trajectory.
            schedule: Its mode schedule.
            planned: True if it belongs to a plan, False for a stop or a hold. Only a plan counts as
                being executed in `plan_stamp_ns` and `stop`.
        """
        self._followed.append((self.plan_time_ns, trajectory))
        self._servo.follow(self._time_ns, trajectory, schedule, planned=planned)

    def _choose_holding_modes(self, q: FloatArray) -> ModeArray:
        """Choose the modes in which the arm rests in a posture.

        Args:
            q: Joint positions, float64[n], [rad or m].

        Returns:
            Mode of each actuator, uint8[n]. These modes hold the load in the posture. If they need
            more booster modules than there are, the present modes of the mode schedule are
            returned.
        """
        return choose_stop_modes(self.machine, self.machine.piston_forces(q), self._reference.modes)

    def _build_divergence_error(self) -> SimulationDivergedError:
        """Build the error that names the first quantity that is not finite or too large.

        The quantities are checked in a fixed order, causes before effects. Joint positions and
        velocities must be below LARGEST_STATE, other quantities below LARGEST_VALUE. If all of them
        are, the error names the joint motion.

        Returns:
            The error, to be raised.
        """
        servo = self._servo_circuit
        candidates: list[tuple[str, Any, float]] = [
            ("the joint position", self._data.qpos, LARGEST_STATE),
            ("the joint velocity", self._data.qvel, LARGEST_STATE),
            ("the reference", self._signals.reference, LARGEST_VALUE),
            ("a pressure", self._circuit.pressure, LARGEST_VALUE),
            ("the servo's valve command", servo.actuators["valve_command"], LARGEST_VALUE),
            ("the servo's pump command", servo.modules["flow_command"], LARGEST_VALUE),
            ("the joint motion", np.inf, LARGEST_VALUE),
        ]
        quantity = next(
            name
            for name, values, largest in candidates
            if not np.all(np.isfinite(values)) or np.any(np.abs(values) >= largest)
        )
        return SimulationDivergedError(quantity, self._time_ns / SECOND_NS)


def _keep_commands() -> None:
    """Do nothing in place of the servo while the valves are closed."""
