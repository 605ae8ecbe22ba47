"""Who may fetch the page."""

import http.client
import socket
import sys

import pytest

from irbcal.errors import IrbcalError
from irbcal.viewer import view


def get(port, path="/", host=None, address="127.0.0.1"):
    connection = http.client.HTTPConnection(address, port, timeout=5)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def parts(address):
    """Port and path of an address."""
    place, _, path = address.removeprefix("http://").partition("/")
    return int(place.rpartition(":")[2]), f"/{path}"


def test_only_who_knows_the_address_is_served():
    """Another user of this computer finds the port, but not the page; the next view has another address."""
    with view.serving("<p>a</p>", 0) as one, view.serving("<p>b</p>", 0) as other:
        (port, path), (_, foreign) = parts(one), parts(other)
        assert len(path) > 20
        for wrong in ("/", path[:-2], path[:-3] + "/", foreign, "//", f"/x{path}"):
            assert get(port, wrong)[0] == 404, wrong
        assert get(port, path.rstrip("/")) == (200, b"<p>a</p>")


def test_who_says_nothing_is_let_go(monkeypatch):
    monkeypatch.setattr(view, "READ_SECONDS", 0.1)
    with view.serving("<p>a</p>", 0) as address, socket.create_connection(("127.0.0.1", parts(address)[0])) as line:
        line.settimeout(30)
        line.sendall(b"GET /")
        assert line.recv(100) == b""


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
    with view.serving("<p>hello</p>", 0) as address:
        port, path = parts(address)
        assert address.startswith("http://127.0.0.1:")
        assert get(port, path) == (200, b"<p>hello</p>")
        assert get(port, path, host="localhost:9999")[0] == 200  # through a tunnel
        assert get(port, path, host="evil.example")[0] == 403
        assert get(port, "/etc/passwd")[0] == 404
        assert get(port, "/../../etc/passwd")[0] == 404
        for other in own_addresses():
            with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
                socket.create_connection((other, port), timeout=2)
        with pytest.raises(IrbcalError, match=f"port {port} "), view.serving("", port):
            pass
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port), timeout=2)
