"""Web server of the view, which serves this machine only and cannot be made public."""

import contextlib
import io
import logging
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from viser import ViserServer
from viser._messages import GuiUpdateMessage
from websockets.asyncio import server as sockets

from mhsb_model.errors import MhsbError

CAMERA_POSITION = (0.45, -2.6, 0.15)
"""Position of the camera beside the arm [m]."""

LOOK_AT = (0.45, 0.0, -0.1)
"""Point that the camera looks at, in front of the arm: x to the right, z up [m]."""

FIELD_OF_VIEW = 0.75  # rad

LOCAL_ADDRESSES = ("127.0.0.1", "localhost", "::1")
PAGES_OF_HERE = re.compile(r"https?://(127\.0\.0\.1|localhost|\[::1\])(:\d+)?")
"""Pattern of the origins of pages that this machine serves."""


LARGEST_NUMBER = 1e6
"""Largest magnitude of a number that a page may send, whatever its unit."""

LONGEST_TEXT = 200
"""Largest length of a text that a page may send, and of the part of it that a refusal repeats."""


class LocalServer(ViserServer):
    """viser's server without its public tunnel, through which anybody could move the arm.

    Unusable messages of a page are refused in one sentence, where viser would print a traceback.

    Attributes:
        on_refusal: Function that is called with that sentence, in one of the server's threads.
    """

    def __init__(self, host: str, port: int) -> None:
        """Start the server, with a check of the input that pages send to its controls.

        Args:
            host: Address to listen at, such as `127.0.0.1`.
            port: Port; 0 takes any free one. If it is in use, viser takes another one.

        Raises:
            OSError: The server cannot listen at the address.
        """
        super().__init__(host=host, port=port, label="MHSB", verbose=False)
        self.on_refusal: Callable[[str], None] = lambda sentence: None
        self._check_messages_of(self._websock_server)
        self.on_client_connect(lambda client: self._check_messages_of(client._websock_connection))

    def request_share_url(self, verbose: bool = True) -> None:
        """Do nothing, in place of viser's request for a public address."""

    def _check_messages_of(self, connection: Any) -> None:
        """Make a connection check incoming messages before it handles them.

        Only messages that change a control are checked. If a message is refused or its handling
        fails, `on_refusal` is called with a sentence, and no exception leaves the handler.

        Args:
            connection: Connection of viser, of the whole server or of one page; its handler is
                replaced.
        """
        handle = connection._handle_incoming_message

        async def guarded(client_id: int, message: Any) -> None:
            """Check a message if it changes controls, then handle it with the former handler.

            No exception leaves this function. If the check or the handler fails, `on_refusal` is
            called with a sentence; a refused message is not handled.

            Args:
                client_id: Number of the connected page.
                message: The message. Only a `GuiUpdateMessage` is checked.
            """
            try:
                if isinstance(message, GuiUpdateMessage):
                    check_update(message.updates)
                await handle(client_id, message)
            except Exception as error:
                reason = error if isinstance(error, MhsbError) else type(error).__name__
                self.on_refusal(f"what the page has sent is not used: {reason}")

        connection._handle_incoming_message = guarded


def check_update(updates: Mapping[str, Any]) -> None:
    """Check the change of a control that a page asks for.

    Only the property `value` may be changed. Its new value must be a number of at most
    LARGEST_NUMBER in magnitude, a text of at most LONGEST_TEXT characters, or a list of these.

    Args:
        updates: New values by name of the control's property.

    Raises:
        MhsbError: Another property would be changed, or the value is not allowed.
    """
    for name, value in updates.items():
        if name != "value":
            raise MhsbError(f"'{str(name)[:LONGEST_TEXT]}' is no value")
        for each in value if isinstance(value, list | tuple) else [value]:
            short = isinstance(each, str) and len(each) <= LONGEST_TEXT
            number = isinstance(each, int | float) and abs(each) <= LARGEST_NUMBER
            if not (short or number):
                raise MhsbError(
                    f"{repr(each)[:LONGEST_TEXT]} must be a number of at most {LARGEST_NUMBER:g}"
                )


def open_server(host: str, port: int, size: float = 1.0) -> LocalServer:
    """Start the web server of the view, and set its theme and camera.

    If `host` is a local address, web pages from other machines that are open in the user's browser
    cannot connect (check of the origin). Log messages of the package websockets below the level
    CRITICAL are suppressed in this process.

    Args:
        host: Address to listen at, such as `127.0.0.1`.
        port: Port; 0 takes any free one.
        size: Size of the arm relative to the paper's arm; it scales the distance of the camera.

    Returns:
        The running server.

    Raises:
        MhsbError: The address cannot be used, or the port is in use.
    """
    # Browsers open spare connections; websockets would log a traceback for each unused one.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    try:
        # viser prints a box on standard output; the command prints one line instead.
        with contextlib.redirect_stdout(io.StringIO()), _allow_local_pages_only(host):
            server = LocalServer(host, port)
    except OSError as error:
        raise MhsbError(
            f"the page cannot be served at {host}:{port} ({error.strerror or error}); give "
            "--port 0 for any that is free"
        ) from error
    if port not in (0, server.get_port()):
        server.stop()
        raise MhsbError(
            f"port {port} is in use; end what uses it or give --port 0 for any that is free"
        )
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    camera = server.initial_camera
    camera.position, camera.look_at = size * np.array(CAMERA_POSITION), size * np.array(LOOK_AT)
    camera.fov = FIELD_OF_VIEW
    return server


@contextlib.contextmanager
def _allow_local_pages_only(host: str) -> Iterator[None]:
    """Make web servers that start in a `with` block refuse pages from other machines.

    Context manager; it replaces `websockets.serve` while the block lasts. A browser lets any page
    open a web socket to any address, so a page from the internet could otherwise move the arm.
    Programs that are no browsers state no origin and are accepted.

    Args:
        host: Address that the server listens at. If it is not a local address, nothing is
            restricted.
    """
    changed: Any = sockets
    serve = sockets.serve
    if host in LOCAL_ADDRESSES:
        changed.serve = partial(serve, origins=[PAGES_OF_HERE, None])
    try:
        yield
    finally:
        changed.serve = serve
