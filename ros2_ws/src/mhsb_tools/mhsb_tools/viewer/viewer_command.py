"""Command `view`: the arm live in a browser, or playback of a recording."""

from pathlib import Path
from typing import Annotated

import tyro

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import NumberRange, OptionalFile
from mhsb_tools.recording.bag_reader import read_recording

DEFAULT_PORT = 8080


def viewer(
    bag: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[BAG]")] = None,
    machine: OptionalFile = None,
    port: Annotated[int, NumberRange(0, 65535)] = DEFAULT_PORT,
    host: str = "127.0.0.1",
) -> int:
    """Show the arm in a browser: live, or a recording with a time slider.

    The live view shows the arm with its cylinders in the colour of their mode, planned path, zones,
    pressures [MPa], modes, energy [J] and verdicts. A goal is typed [m] or dragged; planner,
    weights and payload can be set. Open the printed address in any browser on this machine.

    Args:
        bag: Folder of a recording (rosbag2) to play back; live if omitted.
        machine: Machine file (YAML) of the arm; the suite's own if omitted.
        port: Port of the page on this machine; 0 takes any free one.
        host: Address to listen at; 0.0.0.0 lets everybody in the network move the arm.

    Returns:
        The exit code 0, once a signal ends the process.

    Raises:
        BagError: The recording cannot be used.
        MhsbError: The machine file or the address cannot be used, the port is in use, or ROS cannot
            make a node.
    """
    arm = load_machine(machine)
    recording = read_recording(bag, slews=arm.slews) if bag else None
    from mhsb_tools.viewer.server import open_server

    server = open_server(host, port, arm.relative_size)
    print(f"ready: http://{host}:{server.get_port()}", flush=True)
    if recording is not None:
        from mhsb_tools.viewer.playback import play_recording

        return play_recording(server, arm, recording)
    from mhsb_msgs_py.node_process import spin_node
    from mhsb_tools.viewer.viewer_node import ViewerNode

    return spin_node(lambda: ViewerNode(server, arm))


main = command_line.make_main(viewer, node=True)
