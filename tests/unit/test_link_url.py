"""Addresses of links, as MAVSDK writes them."""

from __future__ import annotations

import pytest

from swarm_ctl.errors import SwarmError
from swarm_ctl.link.url import BAUD, Address, parse, spread


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("udpin://0.0.0.0:14540", Address("udpin", "0.0.0.0", 14540)),  # noqa: S104 - read only
        ("udpin://0.0.0.0:0", Address("udpin", "0.0.0.0", 0)),  # noqa: S104 - the same
        ("udpout://192.168.1.12:14580/", Address("udpout", "192.168.1.12", 14580)),
        ("tcpout://localhost:5760", Address("tcpout", "localhost", 5760)),
        ("serial:///dev/ttyACM0:921600", Address("serial", "/dev/ttyACM0", 921600)),
        ("serial:///dev/ttyACM0", Address("serial", "/dev/ttyACM0", BAUD)),
        (
            "serial:///dev/serial/by-id/usb-Auterion_PX4_FMU-if00:57600",
            Address("serial", "/dev/serial/by-id/usb-Auterion_PX4_FMU-if00", 57600),
        ),
    ],
)
def test_an_address_is_read_as_mavsdk_reads_it(url: str, address: Address) -> None:
    assert parse(url) == address


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("", "expected udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT or serial:///"),
        ("14540", "expected udpin://"),
        ("127.0.0.1:14540", "expected udpin://"),
        ("udp://:14540", "expected udpin://"),
        ("tcpin://127.0.0.1:5760", "expected udpin://"),
        ("udpin://", "expected udpin://HOST:PORT"),
        ("udpin://127.0.0.1", "expected udpin://HOST:PORT"),
        ("udpin://127.0.0.1:", "expected udpin://HOST:PORT"),
        ("udpin://:14540", "expected udpin://HOST:PORT"),
        ("udpin://127.0.0.1:14540/path", "expected udpin://HOST:PORT"),
        ("tcpout://127.0.0.1", "expected tcpout://HOST:PORT"),
        ("tcpout://127.0.0.1:0", "nobody listens on port 0"),
        ("udpout://127.0.0.1:0", "nobody listens on port 0"),
        ("udpin://127.0.0.1:port", "expected udpin://HOST:PORT"),
        ("udpin://127.0.0.1:70000", "expected udpin://HOST:PORT, with a port of 1 to 65535"),
        ("udpin://127.0.0.1:-1", "expected udpin://HOST:PORT"),
        ("udpin://[::1:14540", "expected udpin://HOST:PORT"),
        ("serial://ttyACM0:57600", "expected serial:///DEVICE:BAUD"),
        ("serial:///dev/ttyACM0:fast", "expected serial:///DEVICE:BAUD"),
        ("serial:///dev/ttyACM0:", "expected serial:///DEVICE:BAUD"),
        ("serial:///dev/ttyACM0:0", "expected serial:///DEVICE:BAUD"),
    ],
)
def test_a_mistake_in_an_address_is_one_sentence_that_names_it(url: str, sentence: str) -> None:
    with pytest.raises(SwarmError) as caught:
        parse(url)
    assert str(caught.value).startswith(f"{url}: {sentence}")
    assert "\n" not in str(caught.value)


def test_a_range_of_ports_is_an_address_for_each() -> None:
    url = "udpout://10.0.0.2:14580-14582"
    three = [f"udpout://10.0.0.2:{port}" for port in (14580, 14581, 14582)]
    assert spread(["serial:///dev/ttyACM0", url]) == ["serial:///dev/ttyACM0", *three]
    assert spread(["udpin://0.0.0.0:7-7"]) == ["udpin://0.0.0.0:7"]
    for ports in ("14589-14580", "0-3", "65530-65536"):
        with pytest.raises(SwarmError, match="expected the first and the last port"):
            spread([f"udpout://10.0.0.2:{ports}"])
