"""The guardian: whom it stops, when, and that it keeps its hands off everybody else."""

from __future__ import annotations

import json

from swarm_ctl.run.guardian import HELD_S, Guardian

HANG_S = 0.5


class Story:
    """Controllers that speak, fall silent and come back, told second by second."""

    def __init__(self) -> None:
        self.journals = dict.fromkeys(range(10), 100)
        self.guardian = Guardian(HANG_S, lambda sysid: self.journals[sysid])
        self.now = 1000.0

    def tell(self, sysid: int, frame: bytes = b"stop") -> None:
        told = {"sysid": sysid, "reach": f"udpout://10.0.0.{sysid}:14580", "frame": frame.hex()}
        self.guardian.hear(json.dumps({**told, "stamp": 0}).encode(), self.now)

    def live(self) -> None:
        """Say that nothing has changed."""
        self.guardian.hear(b"", self.now)

    def steer(self, *sysids: int, seconds: float = 1.0) -> None:
        """Let controllers steer and tell of it, ten times a second."""
        for _ in range(round(seconds * 10)):
            for sysid in sysids:
                self.tell(sysid)
            self.now += 0.1

    def stopped(self, seconds: float = 0.0) -> list[str]:
        """Let time pass; give who is being stopped at its end."""
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            self.guardian.due(self.now)
        return [ward.reach for ward in self.guardian.due(self.now)]


VEHICLE_1, VEHICLE_2 = "udpout://10.0.0.1:14580", "udpout://10.0.0.2:14580"


def test_a_controller_that_lives_is_left_alone() -> None:
    story = Story()
    story.steer(1, 2, seconds=60.0)
    assert story.stopped() == []


def test_whose_process_dies_is_stopped_at_once() -> None:
    story = Story()
    story.steer(1, 2)
    story.guardian.is_bereft = True
    assert story.stopped() == [VEHICLE_1, VEHICLE_2]


def test_who_is_not_being_steered_is_never_touched() -> None:
    story = Story()
    story.steer(1, 2)
    story.tell(1, frame=b"")  # a pilot has it, or it lands by itself
    story.guardian.is_bereft = True
    assert story.stopped(seconds=5.0) == [VEHICLE_2]


def test_a_controller_that_hangs_is_stepped_in_for_until_it_speaks_again() -> None:
    story = Story()
    story.steer(1, 2)
    story.now += HANG_S - 0.2
    assert story.stopped() == []
    story.now += 0.3
    assert story.stopped() == [VEHICLE_1, VEHICLE_2]
    story.live()
    assert story.stopped() == []


def test_who_hung_for_long_is_looked_after_again_when_it_goes_on_as_before() -> None:
    story = Story()
    story.steer(1)
    assert story.stopped(seconds=HELD_S + 2.0) == []
    story.live()
    assert story.stopped() == []
    assert story.stopped(seconds=HANG_S + 0.1) == [VEHICLE_1]


def test_it_is_done_when_all_are_down_taken_over_or_held_long_enough() -> None:
    story = Story()
    story.steer(1, 2)
    story.tell(1, frame=b"")
    assert not story.guardian.is_done
    story.guardian.is_bereft = True
    story.stopped(seconds=1.0)
    assert not story.guardian.is_done
    story.journals[2] += 50
    story.stopped()
    assert story.guardian.is_done


def test_a_vehicle_whose_journal_grows_is_somebody_else_s() -> None:
    story = Story()
    story.steer(1, 2)
    story.guardian.is_bereft = True
    story.stopped(seconds=3.0)
    story.journals[1] += 50
    assert story.stopped() == [VEHICLE_2]
    assert story.stopped(seconds=1.0) == [VEHICLE_2]


def test_a_torn_line_that_is_cut_off_is_no_successor_s() -> None:
    story = Story()
    story.steer(1)
    story.guardian.is_bereft = True
    story.stopped(seconds=1.0)
    story.journals[1] -= 90
    assert story.stopped(seconds=1.0) == [VEHICLE_1]
    story.journals[1] += 50
    assert story.stopped() == []


def test_nobody_is_held_for_longer_than_ten_seconds() -> None:
    story = Story()
    story.steer(1)
    story.guardian.is_bereft = True
    assert story.stopped(seconds=HELD_S - 0.5) == [VEHICLE_1]
    assert story.stopped(seconds=1.0) == []
    assert story.stopped(seconds=60.0) == []
