"""What is broken on purpose, and whose business each of it is."""

from __future__ import annotations

import pytest

from swarm_ctl.errors import SwarmError
from swarm_ctl.flight import Faults


def test_controllers_are_ours_and_the_rest_is_the_mocks() -> None:
    texts = ["controller:3@90", "dead:2@60", "controller:1@5.5", "fleet@120"]
    faults = Faults.parse(texts, vehicles=3)
    assert faults.controllers == ((5.5, 1), (90.0, 3)), "in the order of their time"
    assert faults.mock == ("dead:2@60", "fleet@120")


def test_nothing_ordered_is_nothing_broken() -> None:
    assert Faults.parse([], vehicles=3) == Faults()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("controller", "expected controller:SYSID@SECONDS"),
        ("controller@3", "expected controller:SYSID@SECONDS"),
        ("controller:1", "expected controller:SYSID@SECONDS"),
        ("controller:one@3", "expected controller:SYSID@SECONDS"),
        ("controller:1@soon", "expected controller:SYSID@SECONDS"),
        ("controller:0@3", "there is no vehicle 0; they are 1 to 3"),
        ("controller:4@3", "there is no vehicle 4; they are 1 to 3"),
        ("controller:1@-1", "needs a time from 0 s on"),
        ("controller:1@nan", "needs a time from 0 s on"),
        ("controller:1@inf", "needs a time from 0 s on"),
    ],
)
def test_a_fault_that_cannot_be_is_named_with_its_reason(text: str, reason: str) -> None:
    with pytest.raises(SwarmError) as caught:
        Faults.parse(["dead:1@3", text], vehicles=3)
    assert str(caught.value) == f"--fault {text}: {reason}"
