"""The web server of the view: on this machine alone, and with no way to make it public."""

from __future__ import annotations

import contextlib
import io
import logging
import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from viser import ViserServer
from websockets.asyncio import server as sockets

from mhsb_model.errors import MhsbError

CAMERA = (0.45, -2.6, 0.15)
LOOK_AT = (0.45, 0.0, -0.1)
"""Beside the arm: x to the right, z up [m]."""

FIELD_OF_VIEW = 0.75  # rad

HERE = ("127.0.0.1", "localhost", "::1")
PAGES_OF_HERE = re.compile(r"https?://(127\.0\.0\.1|localhost|\[::1\])(:\d+)?")


class LocalServer(ViserServer):
    """viser's server without its tunnel, by which anybody in the world could move the arm."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Not here."""


def open_server(host: str, port: int, size: float = 1.0) -> ViserServer:
    """A server at that address; raises MhsbError where there cannot be one.

    size  of what is looked at, the paper's arm is 1
    """
    # Browsers open connections ahead that they do not use, of which it tells with a traceback.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    try:
        # It draws a box on standard output, where we say one line.
        with contextlib.redirect_stdout(io.StringIO()), _pages_of_here_only(host):
            server = LocalServer(host=host, port=port, label="MHSB", verbose=False)
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
    camera.position, camera.look_at = size * np.array(CAMERA), size * np.array(LOOK_AT)
    camera.fov = FIELD_OF_VIEW
    return server


@contextlib.contextmanager
def _pages_of_here_only(host: str) -> Iterator[None]:
    """Have a server that is started meanwhile talk to pages of this machine, and to no others.

    Otherwise any page of the internet that is open in a browser here could move the arm: browsers
    let pages open web sockets to anywhere. What is no browser names no origin.
    """
    changed: Any = sockets
    serve = sockets.serve
    if host in HERE:
        changed.serve = partial(serve, origins=[PAGES_OF_HERE, None])
    try:
        yield
    finally:
        changed.serve = serve
