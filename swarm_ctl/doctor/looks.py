"""What of a vehicle itself may not be as it should: a function for each row of the checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from statistics import median

from swarm_ctl.autopilot.telemetry import SCAN_HZ
from swarm_ctl.doctor import ranging
from swarm_ctl.doctor.rows import Case

SYSIDS = range(1, 251)
MULTIROTORS = {
    2: "quadrotor",
    3: "coaxial",
    4: "helicopter",
    13: "hexarotor",
    14: "octorotor",
    15: "tricopter",
    29: "dodecarotor",
    35: "decarotor",
    43: "multirotor",
}
"""MAV_TYPE of what can hover and turn on the spot."""
LOCAL_SETPOINTS = 128
"""MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED."""
CRITICAL = {5: "critical", 6: "emergency", 7: "powering off", 8: "terminated"}
"""MAV_STATE of what does not fly."""
ESTIMATES: Mapping[str, int] = {
    "attitude": 1,
    "horizontal velocity": 2,
    "vertical velocity": 4,
    "horizontal position": 8 | 16,
    "height": 32 | 64,
}
"""What is needed of ESTIMATOR_STATUS_FLAGS and EKF_STATUS_FLAGS; one bit of several will do."""
PX4_FAULTS = {1024: "GPS glitch", 2048: "bad accelerometers"}
"""Bits of ESTIMATOR_STATUS_FLAGS; PX4 sets 128, constant position, also where all is well."""
ARDUPILOT_FAULTS = {128: "no position at all", 1024: "not initialised", 32768: "GPS glitch"}
"""Bits of EKF_STATUS_FLAGS."""
POSITION = "LOCAL_POSITION_NED"
OPTIONAL = frozenset({"CURRENT_MODE"})
"""Streams that come as often as there is something new, or not at all in older versions."""
FIX_3D = 3
"""GPS_FIX_TYPE; more is better."""
CLOCK_TOLERANCE = 0.1
FRESH_BATTERY = 0.5
DEFAULT_RESERVE = 0.25
"""Without a mission: what a mission has by default."""
OVERFLOW_PORT = ":14549"


# who it is


def sysid(case: Case) -> Iterator[str]:
    """Find a sysid that no peer can use."""
    if case.chart.sysid not in SYSIDS:
        yield f"sysid {case.chart.sysid}"


def kind(case: Case) -> Iterator[str]:
    """Find what cannot be flown by velocities."""
    beat = case.chart.heartbeat
    if case.chart.autopilot is None:
        yield f"MAV_AUTOPILOT {beat.autopilot}"
    if beat.type not in MULTIROTORS:
        yield f"MAV_TYPE {beat.type}"


def twins(case: Case) -> Iterator[str]:
    """Find several vehicles behind one sysid of one link."""
    if len(case.chart.uids) > 1:
        yield f"{len(case.chart.uids)} vehicles answer: uids {', '.join(sorted(case.chart.uids))}"


def capabilities(case: Case) -> Iterator[str]:
    """Find a firmware that takes no setpoints."""
    version = case.chart.version
    if version is not None and not version.capabilities & LOCAL_SETPOINTS:
        yield "it says that it cannot"


def rivals(case: Case) -> Iterator[str]:
    """Find another controller at work."""
    if case.chart.rivals:
        yield f"{case.chart.rivals} heartbeats of component 191"


# its link


def answers(case: Case) -> Iterator[str]:
    """Find a link that leads in one direction only."""
    if not case.chart.armed and not case.chart.is_answering:
        yield "it is heard and does not answer"


def one_way_port(case: Case) -> Iterator[str]:
    """Find a port of PX4's that this examination has bound to itself."""
    if case.chart.is_px4 and case.chart.place.startswith("udpout"):
        yield case.chart.place.split()[0]


def overflow(case: Case) -> Iterator[str]:
    """Find the port where PX4's simulators mix."""
    url = case.chart.place.split()[0]
    if case.chart.is_px4 and url.startswith("udpin") and url.endswith(OVERFLOW_PORT):
        yield url


def clock(case: Case) -> Iterator[str]:
    """Find a clock that goes faster or slower than ours."""
    rate = case.chart.clock_rate
    if rate is not None and abs(rate - 1.0) > CLOCK_TOLERANCE:
        asked = f"say --speed {rate * case.speed:.2g}"
        yield f"its clock goes {rate:.3g} times as fast as expected: {asked}"


def round_trip(case: Case, least_s: float, most_s: float) -> Iterator[str]:
    """Find a median round trip within bounds."""
    trips = case.chart.round_trips_s
    if trips and least_s < median(trips) <= most_s:
        yield f"{median(trips) * 1e3:.0f} ms there and back"


def loss(case: Case, least: float, most: float) -> Iterator[str]:
    """Find a share of lost messages within bounds."""
    chart = case.chart
    share = chart.lost / max(chart.lost + chart.frames, 1)
    if least < share <= most:
        yield f"{share:.1%} of {chart.lost + chart.frames} messages are lost"


def streams(case: Case) -> Iterator[str]:
    """Find streams that come too rarely."""
    pilot = case.chart.autopilot
    for name, wanted_hz in pilot.streams_hz.items() if pilot else ():
        rate_hz = case.chart.rate_hz(name)
        is_elsewhere = name in {*OPTIONAL, ranging.RANGES} or (name == POSITION and not rate_hz)
        if not is_elsewhere:
            yield from _slow(name, rate_hz, wanted_hz, case)


def scan(case: Case) -> Iterator[str]:
    """Find a level scan that comes too rarely."""
    for name, wanted_hz in SCAN_HZ.items():
        yield from _slow(name, case.chart.rate_hz(name), wanted_hz, case)


def _slow(name: str, rate_hz: float, wanted_hz: float, case: Case) -> Iterator[str]:
    if case.chart.measured_s and rate_hz < ranging.GOOD_SHARE * wanted_hz:
        yield f"{name} {rate_hz:.1f} Hz of {wanted_hz:g} Hz"


def signing(case: Case) -> Iterator[str]:
    """Find signatures on one side only."""
    chart = case.chart
    if chart.is_signed and not case.has_key:
        yield "it signs what it says, and there is no key"
    if chart.refused:
        yield f"{chart.refused} frames are not signed with the key"


# its readiness


def armed(case: Case) -> Iterator[str]:
    """Find an armed vehicle."""
    if case.chart.armed:
        yield "armed; nothing was asked of it"


def state(case: Case) -> Iterator[str]:
    """Find a failsafe at work."""
    state = CRITICAL.get(case.chart.telemetry.system_status)
    if state is not None:
        yield state


def prearm(case: Case) -> Iterator[str]:
    """Find a vehicle that would not arm, and its own reasons."""
    if case.chart.measured_s and not case.chart.telemetry.is_ready:
        yield f"it would not arm: {case.chart.reasons or 'it does not say why'}"


def no_position(case: Case) -> Iterator[str]:
    """Find a vehicle that does not tell where it is."""
    if case.chart.measured_s and not case.chart.rate_hz(POSITION):
        yield f"no {POSITION}"


def estimates(case: Case) -> Iterator[str]:
    """Find what the estimator lacks, or complains about."""
    flags = case.chart.estimator
    if flags is None:
        return
    missing = [name for name, bits in ESTIMATES.items() if not flags & bits]
    faults = PX4_FAULTS if case.chart.is_px4 else ARDUPILOT_FAULTS
    found = [f"no {name}" for name in missing]
    found += [fault for bit, fault in faults.items() if flags & bit]
    if found:
        yield ", ".join(found)


def satellites(case: Case) -> Iterator[str]:
    """Find a receiver without a fix."""
    if case.chart.gnss_fix is not None and case.chart.gnss_fix < FIX_3D:
        yield "no fix in three dimensions"


def _battery(case: Case) -> float | None:
    status = case.chart.status
    return (
        None if status is None or status.battery_remaining < 0 else status.battery_remaining / 100
    )


def frame(case: Case) -> Iterator[str]:
    """Find a vehicle that has no place in the frame that the mission's vehicles share."""
    shared = case.mission.frame if case.mission else None
    if shared is None:
        return
    fix, sysid = case.chart.gnss_fix or 0, case.chart.sysid
    if shared.shared == "gnss" and fix < FIX_3D:
        yield "frame.shared is gnss, and it has no fix in three dimensions"
    if shared.shared == "surveyed" and sysid not in shared.starts_m:
        yield f"frame.starts_m lacks vehicle {sysid}"


def unknown_battery(case: Case) -> Iterator[str]:
    """Find a battery nobody watches."""
    if case.chart.status is not None and _battery(case) is None:
        yield "its charge is not known"


def low_battery(case: Case) -> Iterator[str]:
    """Find a battery that ends the mission at once."""
    charge, reserve = _battery(case), _reserve(case)
    if charge is not None and charge <= reserve:
        yield f"{charge:.0%}, and it turns home at {reserve:.0%}"


def used_battery(case: Case) -> Iterator[str]:
    """Find a battery that was flown before."""
    charge = _battery(case)
    if charge is not None and _reserve(case) < charge < FRESH_BATTERY:
        yield f"{charge:.0%}"


def _reserve(case: Case) -> float:
    return case.mission.limits.battery_reserve if case.mission else DEFAULT_RESERVE
