"""What counts as a good record is said before it is estimated: one that informs."""

import good_records
import pytest
from good_records import informs, rotor_bound
from rotor_bank import SETTINGS, rotor_case

from rotorid import MaximumLikelihood, identify


@pytest.mark.parametrize(
    ("name", "seed", "loose", "share"),
    [
        ("4 sensors, weak excitation", 1004, "I_t", 2.20),
        ("4 sensors, standstill, +-40 %", 9, "k1", 0.96),
        ("4 sensors, +-40 %", 900, "I_t", None),
    ],
)
def test_a_record_that_does_not_inform_is_not_good(name, seed, loose, share):
    case = rotor_case(SETTINGS[name], seed)
    bound = {n: b for n, b in rotor_bound(case).items() if n not in good_records.UNBALANCE}
    assert max(bound, key=lambda n: bound[n]) == loose
    assert informs(case) == (share is None)
    if share is not None:
        assert bound[loose] == pytest.approx(share, abs=0.01)


def test_the_bound_is_what_maximum_likelihood_states():
    """From the bank's own matrices, by differences; the estimator's own are another way."""
    case = rotor_case(SETTINGS["5 sensors, +-40 %"], 900)
    estimator = MaximumLikelihood(fixed=case.fixed, start=case.start)
    estimate = identify(case.model, case.records, estimator)
    for name, share in rotor_bound(case).items():
        if name not in good_records.UNBALANCE:
            assert estimate[name].std == pytest.approx(share * case.truth[name], rel=0.15)
