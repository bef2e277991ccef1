"""Identify the EMPS from its measured data and predict its validation record.

    python examples/emps/run.py FOLDER

FOLDER holds DATA_EMPS.mat and DATA_EMPS_PULSES.mat; without it the variable ROTORID_DATA names the
folder that holds emps/. The same by hand, with the two files beside the experiment files:

    rotorid identify experiment.toml --json result.json
    rotorid validate result.json validate.toml
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

import rotorid as rid
from rotorid.answer.predict import predict

HERE = Path(__file__).parent


def main(folder: Path) -> None:
    experiment = rid.load_experiment(HERE / "experiment.toml", folder=folder)
    estimate = rid.identify(experiment.model, experiment.records(), experiment.estimator())
    print(estimate)

    validation = rid.load_experiment(HERE / "validate.toml", folder=folder)
    (periods,) = validation.records()
    print("\nrecord with pulses, force = gtau*vir:", percent(predict_force(estimate, periods)))

    # Were the pulses not part of the controller's output, they would have to be added to it.
    (record,) = validation.measured()
    pulses = rid.read_record(folder / "DATA_EMPS_PULSES.mat", columns=["pulses_N"], time="t")
    samples = record.samples.copy()
    samples[:, record.names.index("F")] += pulses.column("pulses_N")
    added = rid.average(
        replace(record, samples=samples), period_samples=6240, band=(0.0, 40.0), skip=0.724
    )
    print(
        "record with pulses, force = gtau*vir + pulses_N:", percent(predict_force(estimate, added))
    )


def predict_force(estimate: rid.Estimate, periods: rid.PeriodicRecord) -> float:
    """Return the relative error of the predicted force."""
    prediction = predict(rid.load_model("emps"), estimate, periods)["F"]
    assert prediction is not None  # the force is not zero
    return prediction.relative_error


def percent(error: float) -> str:
    return f"relative error {100 * error:.2f} %"


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    elif "ROTORID_DATA" in os.environ:
        main(Path(os.environ["ROTORID_DATA"]) / "emps")
    else:
        sys.exit(__doc__)
