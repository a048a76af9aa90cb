"""Run the servo on recorded signals, as it would run on the sensors of a real machine.

    python examples/09_servo_on_recorded_signals.py

A simulated arm with a heavier payload than its file says stands in for the machine; what its
sensors read is recorded. Then `mhsb_control` alone, which knows neither simulator nor ROS, computes
the valve commands from the record and estimates the machine's parameters (docs/hardware.md).
"""

from mhsb_control import load_machine
from mhsb_control.controller import ServoSignals
from mhsb_control.servo_loop import ServoLoop
from mhsb_model import MotionState
from mhsb_model.circuit.components import describe_components
from mhsb_planner import Planner
from mhsb_sim import Simulator

TRUE_PAYLOAD = 12.5  # [kg]

machine = load_machine()
start = MotionState.at_rest(machine.config.simulation.start_posture)
plan = Planner(machine).plan((0.55, 0.60), start)
trajectory, schedule = plan.motion.trajectory, plan.motion.schedule

simulator = Simulator(machine, "coordinated")
simulator.set_payload(TRUE_PAYLOAD)
record = [(simulator.time_ns, simulator.sensed)]
simulator.set_plan(trajectory, schedule)
while simulator.time_ns < trajectory.end_ns:
    time_ns = simulator.time_ns
    simulator.step()  # one period of the servo
    record.append((time_ns, simulator.sensed))

circuit = describe_components(machine, machine.config.simulation.step)
signals = ServoSignals.at_rest(circuit, schedule.modes[0])


def read(sensed):
    """Write a sample of the record into the signals of the servo."""
    signals.sensors["length"] = sensed.length  # of each cylinder, between its pins [m]
    for k, name in enumerate(("cap_pressure", "rod_pressure", "line_pressure")):
        signals.sensors[name] = sensed.pressure[:, k]  # [Pa]
    signals.rail_pressure[:] = sensed.pressure[:, 2].max()  # has no sensor in this record [Pa]
    circuit.modules["flow"] = sensed.pump_flow  # speed times displacement [m³/s]


read(record[0][1])
servo = ServoLoop("coordinated", machine, signals)
servo.follow(record[0][0], trajectory, schedule)
for time_ns, sensed in record[1:]:
    read(sensed)
    servo.run_period(time_ns)
print(
    f"valve commands in the end: {circuit.actuators['valve_command'].round(4)} of the full opening"
)
for each in servo.controller.estimates:
    if each.known:
        print(f"{each.quantity} {each.actuator}: {each.value:.3g} ± {each.deviation:.1g}")
print(f"true payload: {TRUE_PAYLOAD:g} kg")
