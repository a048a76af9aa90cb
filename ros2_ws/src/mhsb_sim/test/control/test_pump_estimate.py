import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mhsb_control.delay_line import MAX_DELAY, describe_uncompensated_delay
from mhsb_control.pump_estimate import (
    DriveEstimates,
    DriveSettings,
    build_drive_estimates,
    update_drive_estimates,
)
from mhsb_model.machine import Machine
from mhsb_model.records import Records, create_record
from mhsb_sim.simulation.simulator import Simulator

FILE, STEP, FULL, SLEW = 0.02, 1e-3, 5e-6, 4e-4
PERIOD = 120
SETTINGS = DriveSettings()
RECORD = create_record(SETTINGS)[0]


def drive(machine: Machine, lag: float, delay: int, noise: float) -> tuple[DriveEstimates, Records]:
    """What is known after two seconds in which a pump is told to start and to stop."""
    modules = Simulator(machine)._signals.circuit.modules
    drives = build_drive_estimates(FILE, STEP, FULL, SLEW, len(modules))
    random = np.random.default_rng(1)
    told = np.zeros(round(MAX_DELAY / STEP) + 2)
    flow, largest = 0.0, SLEW * STEP
    for k in range(2000):
        modules["flow"][0] = flow + noise * FULL * random.standard_normal()
        update_drive_estimates(drives, modules, RECORD)
        modules["flow_command"][0] = 0.8 * FULL if k % PERIOD < PERIOD // 2 else 0.1 * FULL
        told = np.concatenate([[modules["flow_command"][0]], told[:-1]])
        change = (told[delay] - flow) * -np.expm1(-STEP / lag)
        flow += np.clip(change, -largest, largest)
    return drives, modules


@pytest.mark.parametrize("delay", [0, 2, 5, 20, 40])
@pytest.mark.parametrize("lag", [0.01, 0.02, 0.06])
def test_commands_and_flows_tell_the_lag_and_the_delay(
    machine: Machine, lag: float, delay: int
) -> None:
    own = drive(machine, lag, delay, noise=1e-3)[0].record[0]
    assert own["delay"] == own["max_plausible_delay"] == delay
    assert own["lag"] == pytest.approx(lag, rel=0.05)
    assert own["deviation"] < 0.1 * SETTINGS.initial_deviation


def test_a_pump_that_does_not_move_tells_nothing(machine: Machine) -> None:
    modules = Simulator(machine)._signals.circuit.modules
    drives = build_drive_estimates(FILE, STEP, FULL, SLEW, len(modules))
    modules["flow"], modules["flow_command"] = 0.0, FULL
    assert not any(update_drive_estimates(drives, modules, RECORD) for _ in range(300))
    assert drives.record["lag"][0] == FILE


@pytest.mark.parametrize("step", [5e-4, 1e-3, 5e-3])
def test_the_longest_delay_is_a_time(step: float) -> None:
    drives = build_drive_estimates(FILE, step, FULL, SLEW, 1, delay=0.06)
    assert drives.record["delay"][0] * step == pytest.approx(0.06)
    assert drives.commands.shape[1] - 1 == drives.record["delay"][0]


@pytest.mark.parametrize("declared", [0.0, 0.058, 0.06, 0.15])
def test_a_declared_delay_is_not_known_before_a_pump_has_started(
    machine: Machine, declared: float
) -> None:
    delayed = machine.with_values({"imperfections.computing_delay": declared})
    simulator = Simulator(delayed)
    (delay,) = (each for each in simulator.estimates if each.quantity == "delay")
    assert not delay.known
    assert delay.value == pytest.approx(min(declared, MAX_DELAY))


def test_a_declared_delay_beyond_the_longest_is_said_not_to_be_compensated(
    machine: Machine, caplog: pytest.LogCaptureFixture
) -> None:
    assert describe_uncompensated_delay(machine) is None
    Simulator(machine.with_values({"imperfections.computing_delay": 0.15}))
    (record,) = (each for each in caplog.records if "computing_delay" in each.message)
    assert "is 150 ms" in record.message
    assert "60 ms; use lag_compensated" in record.message


def test_the_flow_that_is_foreseen_is_the_one_that_comes(machine: Machine) -> None:
    lag, delay = 0.05, 4
    drives, _ = drive(machine, lag, delay, noise=0.0)
    flow = drives.previous_flow[0, 0]
    waiting = drives.commands[0, :delay][::-1]
    flows = solve_ivp(
        lambda t, y: [(waiting[min(int(t / STEP), delay - 1)] - y[0]) / lag, y[0]],
        (0.0, delay * STEP), [flow, 0.0], max_step=1e-4,
    )  # fmt: skip
    assert drives.flow[0] == pytest.approx(flows.y[0, -1], rel=0.01)
    assert drives.pending[0] == pytest.approx(flows.y[1, -1], rel=0.01)
