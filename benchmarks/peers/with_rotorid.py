"""rotorid: maximum likelihood from the samples, with all that it asks of its answer."""

from common import NAMES, Case, enter

import rotorid as rid

MODEL = rid.load_model("three-mass")
UNBALANCE = ("xi", "zeta", "mu", "eta")  # needs no start


def solve(case: Case) -> dict:
    told = case.told
    channels = tuple(rid.Channel(name, unit) for name, unit in told["channels"].items())
    samples = case.periods.reshape(-1, len(channels))
    record = rid.Record(channels, samples, told["sample_rate_hz"], speed=case.speed)
    periods = rid.average(
        record, period_samples=told["period_samples"], harmonics=told["harmonics"]
    )
    known, without = told["known"], {*UNBALANCE, *told["known"]}
    start = {name: value for name, value in told["start"].items() if name not in without}
    method = rid.MaximumLikelihood(fixed=known, start=start)
    estimate = rid.identify(MODEL, periods, method)
    if estimate.status in ("not_converged", "not_identifiable"):
        raise ValueError(f"{estimate.status}: {estimate.warnings[0]}")
    found = {"parameters": {name: estimate.value(name) for name in NAMES}}
    found["std"] = {name: estimate.std(name) for name in NAMES if name not in known}
    return found if estimate.status == "ok" else found | {"doubt": estimate.status}


if __name__ == "__main__":
    enter(solve)
