"""Who may fetch the page."""

import http.client
import socket
import sys

import pytest

from irbcal.errors import IrbcalError
from irbcal.viewer import server


def get(port, path="/", host=None, address="127.0.0.1"):
    connection = http.client.HTTPConnection(address, port, timeout=5)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def own_addresses():
    """Addresses of this computer other than 127.0.0.1; all of 127/8 is this computer on Linux."""
    addresses = ["127.0.0.2"] if sys.platform == "linux" else []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # nothing is sent: this only chooses an interface
            addresses.append(probe.getsockname()[0])
        except OSError:
            pass
    return addresses


def test_only_this_computer_is_served():
    with server.serving("<p>hello</p>", 0) as address:
        port = int(address.rstrip("/").rsplit(":", 1)[1])
        assert address.startswith("http://127.0.0.1:")
        assert get(port) == (200, b"<p>hello</p>")
        assert get(port, host="localhost:9999")[0] == 200  # through a tunnel
        assert get(port, host="evil.example")[0] == 403
        assert get(port, "/etc/passwd")[0] == 404
        assert get(port, "/../../etc/passwd")[0] == 404
        for other in own_addresses():
            with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
                socket.create_connection((other, port), timeout=2)
        with pytest.raises(IrbcalError, match=f"port {port} "), server.serving("", port):
            pass
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port), timeout=2)
