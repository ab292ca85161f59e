import itertools

import pytest

from swarm_ctl.agent.phases import ENDED, STEERING, TABLE, Cause, Phase, advance
from swarm_ctl.errors import PhaseError


@pytest.mark.parametrize(("phase", "cause"), list(itertools.product(Phase, Cause)))
def test_a_change_happens_only_when_the_table_has_it(phase: Phase, cause: Cause) -> None:
    if (phase, cause) in TABLE:
        assert advance(phase, cause) is TABLE[phase, cause]
    else:
        with pytest.raises(PhaseError, match=phase.value):
            advance(phase, cause)


def test_nothing_leads_out_of_the_end() -> None:
    assert not [pair for pair in TABLE if pair[0] in ENDED]


def test_every_phase_that_steers_yields_to_a_pilot_and_can_land() -> None:
    for phase in STEERING:
        assert TABLE[phase, Cause.PILOT] is Phase.YIELDED
        assert TABLE[phase, Cause.LAND] is Phase.LANDING


def test_every_phase_can_end() -> None:
    reached = {phase: {TABLE[pair] for pair in TABLE if pair[0] is phase} for phase in Phase}
    for phase in set(Phase) - ENDED:
        seen, queue = {phase}, [phase]
        while queue:
            for after in reached[queue.pop()] - seen:
                seen.add(after)
                queue.append(after)
        assert Phase.DONE in seen, phase
        assert Phase.FAILED in reached[phase], phase
