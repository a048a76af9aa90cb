"""What the tests of all packages share: a ROS domain, child processes, two more machines.

Each test run holds a lock on one ROS domain in which nobody is, so that runs side by side, and
nodes that are started by hand, do not hear each other.
"""

from __future__ import annotations

import copy
import fcntl
import os
import random
import re
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import settings
from tests.support.motions import inverse_dynamics

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.hydraulics import needs_boost
from mhsb_model.linkages.linkage import evaluate_linkage_at_angles
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode, count_modules
from mhsb_model.schema import MachineConfig
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray, ModeArray

settings.register_profile("mhsb", deadline=None, derandomize=True)
settings.load_profile("mhsb")

RERUNS = Path(__file__).parent / "out" / "tests_tried_again.txt"
"""Names and messages of all tests that were tried again, of every run."""


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Draw the seed of this run's random inputs unless it is given; worker processes inherit it."""
    if config.option.hypothesis_seed is None:
        config.option.hypothesis_seed = random.SystemRandom().getrandbits(32)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Try a test once more if it fails and is marked for that."""
    for item in items:
        if item.get_closest_marker("tried_again") is not None:
            item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the seed of random inputs, and name and message of each test that was tried again."""
    seed = config.option.hypothesis_seed
    terminalreporter.write_line(f"random inputs: repeat them with --hypothesis-seed={seed}")
    reruns = [
        f"tried again: {report.nodeid}: {getattr(report.longrepr, 'reprcrash', report.longrepr)}"
        for report in terminalreporter.stats.get("rerun", [])
    ]
    if reruns and not hasattr(config, "workerinput"):
        RERUNS.parent.mkdir(exist_ok=True)
        with RERUNS.open("a", encoding="utf-8") as file:
            file.writelines(f"{each}\n" for each in reruns)
        for each in reruns:
            terminalreporter.write_line(each)


@pytest.fixture
def fresh_seed(request: pytest.FixtureRequest) -> int:
    """A seed of random inputs, another one in each run and each test; the run's seed decides it."""
    run = request.config.option.hypothesis_seed
    return random.Random(f"{run} {request.node.nodeid}").getrandbits(32)


GRACE_PERIOD = 3.0
"""Time for a process to end by itself when its test is over [s]."""

HIGHEST_DOMAIN = 70  # domains up to 101, above which Linux hands out the ports, are left to users
FIRST_PORT, PORTS_OF_A_DOMAIN = 7400, 250  # by the RTPS specification

FOUR_BARS = yaml.safe_load("""
- limits: {lower: -1.571, upper: 2.269}
  linkage:
    kind: four_bar
    rocker_pivot: {radius: 0.0522, angle: 2.1243}
    rocker_length: 0.0968
    rocker_side: left
    coupler_length: 0.0776
    child_pin: {radius: 0.0603, angle: -1.8112}
    parent_pin: {radius: 0.3241, angle: -1.8675}
- limits: {lower: -2.706, upper: -0.087}
  linkage:
    kind: four_bar
    rocker_pivot: {radius: 0.0300, angle: 0.9921}
    rocker_length: 0.0711
    rocker_side: left
    coupler_length: 0.0536
    child_pin: {radius: 0.0359, angle: -1.5621}
    parent_pin: {radius: 0.2384, angle: 3.2289}
- limits: {lower: -2.618, upper: 0.0}
  linkage:
    kind: four_bar
    rocker_pivot: {radius: 0.0435, angle: 1.0688}
    rocker_length: 0.0861
    rocker_side: left
    coupler_length: 0.0689
    child_pin: {radius: 0.0300, angle: -1.5513}
    parent_pin: {radius: 0.1739, angle: 3.0892}
""")
"""Joints of the suite's arm on four-bars, with which it reaches every point of its workspace.

Found by `docs/four_bar_search.py` for arms of 45, 36 and 28 mm.
"""


SLIDER_CRANKS = yaml.safe_load("""
- limits: {lower: -0.84, upper: 1.52}
  linkage:
    kind: slider_crank
    parent_pin: {radius: 0.25, angle: -1.57}
    child_pin: {radius: 0.05, angle: -0.26}
- limits: {lower: -2.05, upper: 0.14}
  linkage:
    kind: slider_crank
    parent_pin: {radius: 0.20, angle: 2.95}
    child_pin: {radius: 0.040, angle: 5.43}
- limits: {lower: -2.20, upper: 0.20}
  linkage:
    kind: slider_crank
    parent_pin: {radius: 0.20, angle: 2.95}
    child_pin: {radius: 0.030, angle: 5.45}
""")
"""Joints that can be stretched out, and leave a fifth of the workspace out of reach."""


def arm_with(joints: list[dict[str, object]], name: str) -> dict[str, Any]:
    """Content of the suite's machine file with other linkages and limits."""
    content = yaml.safe_load(find_config_file(MACHINE_FILE).read_text(encoding="utf-8"))
    content["name"] = name
    for joint, change in zip(content["joints"], joints, strict=True):
        joint.update(change)
    return content


@pytest.fixture(scope="session")
def four_bar_machine() -> Machine:
    """The suite's arm on four-bars of nearly constant arm."""
    return Machine.from_config(MachineConfig.model_validate(arm_with(FOUR_BARS, "four_bar_arm3")))


@pytest.fixture(scope="session")
def slider_crank_machine() -> Machine:
    """The suite's arm on slider-cranks, with small valves that hardly leak and flow to spare."""
    content = arm_with(SLIDER_CRANKS, "slider_crank_arm3")
    content["hydraulics"]["boost_margin"] = 2e5
    content["hydraulics"]["main_pump"]["max_flow"] = 3.333e-5
    content["hydraulics"]["valve"] |= {"rated_flow": 3.333e-5, "leakage_flow": 5e-7}
    return Machine.from_config(MachineConfig.model_validate(content))


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    """A ROS domain held by this test run alone, set for this process and its children."""
    folder = Path(tempfile.gettempdir()) / f"mhsb_test_domains_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    domains = list(set(range(1, HIGHEST_DOMAIN + 1)) - domains_in_use())
    random.SystemRandom().shuffle(domains)
    for domain in domains:
        with (folder / f"{domain}.lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            os.environ["ROS_DOMAIN_ID"] = str(domain)
            os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"  # up to the profile
            os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(
                find_config_file("fastdds_localhost.xml")
            )
            yield domain
            return
    pytest.fail(f"ROS domains 1 to {HIGHEST_DOMAIN} are in use, by nodes or other runs ({folder})")


def domains_in_use() -> set[int]:
    """ROS domains in which some process of this machine has a UDP port, a node started by hand."""
    tables = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
    lines = [line for table in tables if table.exists() for line in table.open()]
    ports = re.findall(r"^ *\d+: \w+:(\w+) ", "".join(lines), re.MULTILINE)
    return {(int(port, 16) - FIRST_PORT) // PORTS_OF_A_DOMAIN for port in ports}


@pytest.fixture
def ros_context(ros_domain: int) -> Iterator[object]:
    """A fresh `rclpy.Context` in the domain of this run, shut down afterwards."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    yield context
    rclpy.try_shutdown(context=context)


class Child:
    """A child process, in a session of its own; what it prints is kept."""

    def __init__(self, name: str, process: Any) -> None:
        self.name = name
        self.process = process
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.append(line)

    @property
    def output(self) -> str:
        """Everything printed so far, both streams."""
        return "".join(self._lines)

    def wait_for(self, pattern: str, timeout: float = 30.0) -> re.Match[str]:
        """Wait until the output matches the regular expression `pattern`; fails on time-out [s]."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            ended = self.process.poll() is not None
            if ended:
                self._reader.join(1.0)
            if found := re.search(pattern, self.output):
                return found
            if ended:
                break
            time.sleep(0.02)
        raise AssertionError(f"{self.name} did not print {pattern!r}, but:\n{self.output}")

    def wait(self, timeout: float = 60.0) -> int:
        """Wait for the end [s]; returns the exit code."""
        code = self.process.wait(timeout)
        self._reader.join(1.0)
        return code

    def stop(self, signal_number: int = signal.SIGINT, timeout: float = 20.0) -> int:
        """Send a signal, wait for the end [s]; returns the exit code."""
        self.process.send_signal(signal_number)
        return self.wait(timeout)

    def end_if_alive(self) -> None:
        """End what a test has left running, by a signal that lets it leave the ROS graph.

        A middleware whose peers were killed has crashed while it ended itself.
        """
        if self.process.poll() is None:
            for signal_number in (signal.SIGCONT, signal.SIGINT):
                self.process.send_signal(signal_number)
            try:
                self.process.wait(GRACE_PERIOD)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


@pytest.fixture(scope="session")
def child_of(ros_domain: int) -> Callable[..., Child]:
    """Function (command..., environment=None) that starts a `Child` in the domain of this run.

    Whoever calls it ends the child.
    """

    def start(*command: object, environment: dict[str, str] | None = None) -> Child:
        """Start a command in a session of its own, with further environment variables."""
        process = subprocess.Popen(
            [str(word) for word in command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **(environment or {})},
        )
        return Child(Path(str(command[0])).name, process)

    return start


@pytest.fixture
def start_process(child_of: Callable[..., Child]) -> Iterator[Callable[..., Child]]:
    """Function that starts a `Child` as `child_of` does; it is ended after the test."""
    yield from children_by(child_of)


def children_by(make: Callable[..., Child]) -> Iterator[Callable[..., Child]]:
    """Yield a function that makes children; those that are alive afterwards are ended."""
    children: list[Child] = []

    def start(*words: object, **options: Any) -> Child:
        children.append(make(*words, **options))
        return children[-1]

    yield start
    for child in children:
        child.end_if_alive()


@pytest.fixture
def start(start_process: Callable[..., Child]) -> Callable[..., Child]:
    """Function (package, executable, arguments...) that starts what `ros2 run` would start."""

    def run(package: str, executable: str, *arguments: object, **options: object) -> Child:
        return start_process(installed_executable(package, executable), *arguments, **options)

    return run


@pytest.fixture(scope="session")
def fork_of(ros_domain: int) -> Callable[..., Child]:
    """Function (package, executable, arguments...) that starts a `Child` in a fork.

    Whoever calls it ends the child.
    """
    from tests.forks.forked_process import ForkedProcess, call_executable

    def start(package: str, executable: str, *arguments: object) -> Child:
        words = [executable, *map(str, arguments)]
        program = partial(call_executable, package)
        return Child(executable, ForkedProcess(program, words, dict(os.environ)))

    return start


@pytest.fixture
def start_fork(fork_of: Callable[..., Child]) -> Iterator[Callable[..., Child]]:
    """Function that starts an installed executable; its process is ended after the test."""
    yield from children_by(fork_of)


@pytest.fixture
def start_script(ros_domain: int) -> Iterator[Callable[..., Child]]:
    """Function (file, arguments...) that runs a script in a fork; it is ended after the test."""
    from tests.forks.forked_process import ForkedProcess, run_script

    def run(file: Path, *arguments: object) -> Child:
        words = [str(each) for each in (file, *arguments)]
        return Child(file.stem, ForkedProcess(run_script, words, dict(os.environ)))

    yield from children_by(run)


def installed_executable(package: str, executable: str) -> Path:
    """Path of an executable in the sourced workspace, where `ros2 run` finds it."""
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "lib" / package / executable
        if path.exists():
            return path
    raise AssertionError(f"no executable {executable} of {package}; is scripts/env.sh sourced?")


@pytest.fixture
def eventually() -> Callable[..., None]:
    """Function (condition, timeout=10 s) that polls until `condition()` is true, or fails."""

    def wait(condition: Callable[[], bool], timeout: float = 10.0) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"not so after {timeout} s"
            time.sleep(0.02)

    return wait


POINT_SPACING = 0.02  # s
SWITCH_MARGIN = 7  # points by which a boost begins early and ends late

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The suite's own arm."""
    return load_machine()


@pytest.fixture(scope="session")
def motion(machine: Machine) -> Motion:
    """Quintic from a state to rest at a posture, as fast as speed and pump allow, with modes."""

    def make(
        start: MotionState,
        goal: FloatArray,
        stamp_ns: int = 0,
        speed: float = 0.012,
        of: Machine = machine,
    ) -> tuple[Trajectory, ModeSchedule]:
        trajectory = _quintic(of, start, np.asarray(goal, dtype=float), stamp_ns, speed)
        return trajectory, _schedule(of, trajectory)

    return make


def _quintic(
    machine: Machine, start: MotionState, goal: FloatArray, stamp_ns: int, speed: float
) -> Trajectory:
    """The shortest within joint limits, piston speed [m/s] and the main pump's flow."""
    m, zero = machine.arrays, np.zeros(machine.joint_count)
    flow = m.main_pump_flow - machine.joint_count * m.leakage_flow
    for duration in np.geomspace(0.4, 60.0, 100):
        points = int(np.ceil(duration / POINT_SPACING)) + 1
        q, qd, qdd = quintic_hermite(
            np.linspace(0.0, duration, points)[:, None],
            np.array([[duration]]),
            (start.position, start.velocity, start.acceleration),
            (goal, zero, zero),
        )
        pistons = _moment_arms(machine, q) * qd
        inlets = np.where(pistons > 0.0, m.cap_area, m.rod_area)
        inside = np.all((q >= m.joint_min - 1e-9) & (q <= m.joint_max + 1e-9))
        drawn = (np.abs(pistons) * inlets).sum(axis=1)
        if inside and np.abs(pistons).max() <= speed and drawn.max() <= flow:
            break
    else:
        pytest.fail(f"no quintic leads from {start.position} within limits to {goal} rad")
    qd[-1] = 0.0
    offsets = np.round(np.linspace(0.0, duration, points) * SECOND_NS).astype(np.int64)
    return Trajectory(stamp_ns, offsets, q, qd, qdd)


def _moment_arms(machine: Machine, q: FloatArray) -> FloatArray:
    """Moment arms of all joints in several postures, float64[postures, n]."""
    joints = zip(machine.arrays.linkage, np.ascontiguousarray(q.T), strict=True)
    return np.array([evaluate_linkage_at_angles(*joint)[:, 1] for joint in joints]).T


def _schedule(machine: Machine, trajectory: Trajectory) -> ModeSchedule:
    """Return modes that begin a little before they are needed, if there are modules for them."""
    modules = machine.config.hydraulics.modules
    needed = _needed_modes(machine, trajectory)
    modes = needed.copy()
    for k in range(len(needed)):
        near = needed[max(0, k - SWITCH_MARGIN) : k + SWITCH_MARGIN + 1].max(axis=0)
        modes[k] = near if count_modules(near, modules.per_mode) <= modules.count else needed[k]
    changes = np.any(np.diff(modes.astype(int), axis=0) != 0, axis=1)
    rows = np.flatnonzero(np.concatenate([[True], changes[:-1], [True]]))
    return ModeSchedule(trajectory.stamp_ns, trajectory.offset_ns[rows], modes[rows])


def _needed_modes(machine: Machine, trajectory: Trajectory) -> ModeArray:
    """Return the modes that load and speed ask for at each point, uint8[points, n]."""
    m, n = machine.arrays, machine.joint_count
    modes = np.zeros(trajectory.position.shape, np.uint8)
    for k, (q, qd, qdd) in enumerate(
        zip(trajectory.position, trajectory.velocity, trajectory.acceleration, strict=True)
    ):
        torque = inverse_dynamics(machine, q, qd, qdd)
        arms = machine.moment_arms(q)
        for j in range(n):
            speed = arms[j] * qd[j]
            if abs(speed) < 2e-4 or k == len(modes) - 1:
                speed = 0.0
            area = m.cap_area[j] if speed > 0 else m.rod_area[j]
            if needs_boost(m, j, torque[j] / arms[j], speed):
                modes[k, j] = Mode.SB if abs(speed) * area > m.servo_pump_flow else Mode.DB
    return modes


@pytest.fixture(scope="session")
def telescope_machine() -> Machine:
    """Two booms, of which the second extends."""
    return load_machine(find_config_file("telescope_arm.yaml"))


SLEW = {
    "kind": "slew",
    "link": {"length": 0.1, "mass": 20.0, "center_of_mass": -0.05, "inertia": 0.4},
    "limits": {"lower": -2.0, "upper": 2.0},
    "linkage": {"kind": "rack_and_pinion", "pitch_radius": 0.05, "bore": 0.025},
}
"""Of a turntable on which the suite's own arm stands."""


@pytest.fixture
def slewing_content(content: dict) -> dict:
    """Content of the suite's machine file, the arm on a turntable, free to be spoiled."""
    return on_a_turntable(content)


@pytest.fixture(scope="session")
def slewing_machine() -> Machine:
    """The suite's own arm on a turntable."""
    content = yaml.safe_load(find_config_file(MACHINE_FILE).read_text(encoding="utf-8"))
    return Machine.from_config(MachineConfig.model_validate(on_a_turntable(content)))


def on_a_turntable(content: dict) -> dict:
    """A machine file of three joints with a fourth beneath."""
    for joint in content["joints"]:
        joint["kind"] = "revolute"
    content["joints"].insert(0, copy.deepcopy(SLEW))
    content["schema_version"] = 2
    content["simulation"]["start_posture"].insert(0, 0.0)
    return content


@pytest.fixture
def content() -> dict:
    """Content of the suite's machine file, free to be spoiled."""
    return yaml.safe_load(find_config_file(MACHINE_FILE).read_text(encoding="utf-8"))
