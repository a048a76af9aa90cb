"""Nothing listens beyond this machine, unless somebody has asked for it."""

from __future__ import annotations

import ipaddress
import os
import signal
import subprocess
from pathlib import Path

import pytest

ENV_FILE = Path(__file__).resolve().parents[1] / "scripts" / "env.sh"
PROFILE = str(ENV_FILE.parents[1] / "config" / "fastdds_localhost.xml")
CHOSEN = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_IMPLEMENTATION")


def addresses_of(process: int) -> list[ipaddress.IPv4Address | ipaddress.IPv6Address]:
    """Local addresses of all UDP and TCP sockets that a process has."""
    links = []
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        try:
            links.append(str(descriptor.readlink()))
        except OSError:  # closed meanwhile
            continue
    sockets = {link.removeprefix("socket:[").rstrip("]") for link in links if "socket:[" in link}
    found = []
    for table in ("udp", "tcp", "udp6", "tcp6"):
        for line in Path(f"/proc/{process}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in sockets:
                digits = fields[1].partition(":")[0]
                words = [digits[at : at + 8] for at in range(0, len(digits), 8)]
                packed = b"".join(bytes.fromhex(word)[::-1] for word in words)
                found.append(ipaddress.ip_address(packed))
    return found


def test_every_socket_of_the_nodes_is_bound_to_the_loopback_interface(observer, start, tmp_path):
    recorder = start("mhsb_tools", "mhsb", "record", "--output", tmp_path / "bag")
    nodes = [start("mhsb_sim", "sim_node"), start("mhsb_planner", "planner_node"), recorder]
    for node in nodes:
        node.wait_for("ready", 180.0)
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    for node in nodes:
        addresses = addresses_of(node.process.pid)
        assert addresses
        assert all(address.is_loopback for address in addresses), (node.name, addresses)
        mapped = Path(f"/proc/{node.process.pid}/maps").read_text()
        assert "/dev/shm/fastrtps" not in mapped  # a node started after kill -9 may not be reached
    for node in nodes:
        assert node.stop(signal.SIGINT) == 0


@pytest.mark.parametrize(
    ("given", "discovery", "profile"),
    [
        ({}, "SYSTEM_DEFAULT", PROFILE),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "SYSTEM_DEFAULT", PROFILE),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "SUBNET", ""),
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": "/mine.xml"}, "LOCALHOST", "/mine.xml"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "LOCALHOST", ""),
        (  # as an earlier sourcing of this or of another checkout has left it
            {
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
                "FASTRTPS_DEFAULT_PROFILES_FILE": "/old/config/fastdds_localhost.xml",
            },
            "SYSTEM_DEFAULT",
            PROFILE,
        ),
        (
            {
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
                "FASTRTPS_DEFAULT_PROFILES_FILE": PROFILE,
            },
            "SUBNET",
            "",
        ),
    ],
)
def test_env_sh_keeps_ros_on_this_machine_unless_told_otherwise(given, discovery, profile):
    environment = {name: value for name, value in os.environ.items() if name not in CHOSEN}
    printed = subprocess.run(
        ["bash", "-c", f'source {ENV_FILE}; printf "%s\\n" "${CHOSEN[0]}" "${CHOSEN[1]}"'],
        env={**environment, **given},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert printed.splitlines() == [discovery, profile]
