from collections.abc import Callable

from flight_log import Flight

from swarm_ctl.agent.phases import Phase
from swarm_ctl.model import Operator
from swarm_ctl.record.contacts import changes, contact_figures
from swarm_ctl.record.journal import read_journal
from swarm_ctl.record.spread import read_contacts

Launch = Callable[..., Flight]
Told = dict[tuple[int, int], list[str]]

EXPLORES = (Phase.EXPLORING, Phase.AVOIDING)


def reports(flight: Flight) -> Told:
    """Give the events in which each vehicle tells of each victim: (sysid, victim)."""
    told: Told = {}
    for line in read_journal(flight.folder.path / "events.jsonl"):
        if line["event"] in {"VictimFound", "VictimHeard"}:
            told.setdefault((line["sysid"], line["data"]["victim"]), []).append(line["event"])
    return told


def everybody_knows(flight: Flight) -> bool:
    return all(controller.agent.victims.known for controller in flight.arena.controllers)


def place_in_world(flight: Flight, sysid: int) -> tuple[float, float]:
    """Say where a vehicle believes the victim to be: north and east of the world's corner."""
    start = flight.arena.fleet.starts_ned_m[sysid - 1]
    (report,) = flight.agent(sysid).victims.known.values()
    return report.position_ned_m.x + start[0], report.position_ned_m.y + start[1]


def test_a_victim_is_told_to_all_peers_in_reach_and_reported_by_each_once(launch: Launch) -> None:
    flight = launch(vehicles=3, duration_s=200.0, world={"radio": {"radius_m": 30.0}})
    flight.fly_until(
        lambda: any(c.agent.victims.seen for c in flight.arena.controllers), within_s=230.0
    )
    flight.fly(1.0)
    assert everybody_knows(flight)
    for sysid in (1, 2, 3):
        north, east = place_in_world(flight, sysid)
        assert abs(north - 4.0) < 0.5
        assert abs(east - 4.0) < 0.5
    flight.fly_to_the_end()
    told = reports(flight)
    assert sorted(told) == [(1, 0), (2, 0), (3, 0)]
    assert sorted(told.values()) == [["VictimFound"], ["VictimHeard"], ["VictimHeard"]]


def test_who_was_out_of_reach_is_told_when_it_is_back(launch: Launch) -> None:
    lossy = {"radius_m": 30.0, "loss_fraction": 0.3}
    flight = launch(  # with this seed the two others find the victim soon: chance, with any
        vehicles=3, duration_s=250.0, seed=2, world={"radio": lossy}, planner={"kind": "explore"}
    )
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.arena.fleet.radio.silence(3)
    flight.arena.controllers[2].order(Operator.PAUSE, flight.arena.now)  # or it finds it by itself
    flight.fly_until(lambda: bool(flight.agent(1).victims.known), within_s=230.0)
    flight.fly_until(lambda: bool(flight.agent(2).victims.known), within_s=3.0)
    flight.fly(5.0)
    lonely = flight.agent(3).victims
    assert not lonely.known
    flight.arena.fleet.radio.restore(3)
    flight.fly_until(lambda: bool(lonely.known), within_s=5.0)
    assert not lonely.seen
    (report,) = lonely.known.values()
    assert report.finder in {1, 2}


def test_the_record_tells_when_the_swarm_was_parted(launch: Launch) -> None:
    parted = {"from_s": 20.0, "until_s": 35.0, "groups": [[1, 2]]}
    flight = launch(vehicles=4, world={"radio": {"radius_m": 30.0, "partitions": [parted]}})
    flight.fly_to_the_end()
    flight.arena.write_truth(flight.folder.path)
    contacts = read_contacts(flight.folder.path)
    assert contacts is not None
    split, rejoining = changes(contacts.graph)
    assert split.is_split
    assert split.parts == rejoining.parts == ((1, 2), (3, 4))
    assert 20.0 <= split.time_s <= 21.1
    assert 35.0 <= rejoining.time_s <= 36.1
    figures = contact_figures(contacts.graph)
    assert (figures["splits"], figures["rejoins"], figures["alone_longest_s"]) == (1, 1, 0.0)
    assert figures["encounters"] == 6 + 4, "four pairs met again"
