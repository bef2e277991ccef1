"""Table 1 of Levy and Arogeti, as printed: data, not results of this program.

The units are corrected (the paper prints N m, N m^2 and N m^3 for the stiffnesses).
"""

from __future__ import annotations

from rotorid.core.frozen import frozen

# Columns of the paper's table and the estimators here that they correspond to.
COLUMNS = {
    "batch-100": "1-step MLE, k = 100",
    "batch-10": "1-step MLE, k = 10",
    "sequential": "Sequential MLE",
    "ls": "1-step MLSE, Sigma = I",
}


@frozen
class PaperRow:
    base: str  # name of the base parameter of the model `three-mass`
    quantity: str  # what the paper lists
    unit: str  # of the paper's quantity
    true: float  # as printed
    errors: tuple[float, float, float, float]  # |error| in % of one run, in the order of `COLUMNS`
    speed_power: int = 0  # the paper's quantity is the base parameter times Omega to this power


TABLE = (
    PaperRow("m1", "m1", "kg", 8.3339e-01, (0.120, 0.177, 0.150, 0.963)),
    PaperRow("m2", "m2", "kg", 1.1322e01, (0.219, 0.298, 0.223, 1.245)),
    PaperRow("m3", "m3", "kg", 8.3339e-01, (0.268, 0.350, 0.287, 1.266)),
    PaperRow("I_t", "I_t", "kg m^2", 2.5425e-02, (0.182, 0.222, 0.157, 0.986)),
    PaperRow("k1", "k1", "N/m", 8.8357e05, (0.119, 0.178, 0.139, 0.996)),
    PaperRow("k2", "k2", "N/m", 8.8357e05, (0.305, 0.403, 0.311, 1.466)),
    PaperRow("k1*L1", "k1 L1", "N", 2.6507e05, (0.194, 0.243, 0.214, 1.014)),
    PaperRow("k2*L2", "k2 L2", "N", 2.6507e05, (0.259, 0.362, 0.259, 1.430)),
    PaperRow(
        "k1*L1^2 + k2*L2^2",
        "k1 L1^2 + k2 L2^2",
        "N m",
        1.5904e05,
        (0.229, 0.306, 0.220, 1.225),
    ),
    PaperRow("I_p", "I_p", "kg m^2", 4.8275e-02, (0.308, 0.344, 0.357, 1.042)),
    PaperRow("m2*xi", "xi m2 Omega^2", "N", 7.7112e01, (0.031, 0.045, 0.048, 0.956), 2),
    PaperRow("m2*zeta", "zeta m2 Omega^2", "N", 1.3356e02, (0.352, 0.430, 0.346, 1.372), 2),
    PaperRow(
        "I_t*mu - I_p*mu",
        "mu (I_t - I_p) Omega^2",
        "N m",
        -1.3145e00,
        (1.389, 1.692, 1.340, 3.868),
        2,
    ),
    PaperRow(
        "I_t*eta - I_p*eta",
        "eta (I_t - I_p) Omega^2",
        "N m",
        -2.2767e00,
        (0.984, 0.943, 0.910, 1.202),
        2,
    ),
)


def printed_error(row: PaperRow, estimator: str) -> float | None:
    """Return the error in % that the paper prints for an estimator; None where it has none."""
    names = list(COLUMNS)
    return row.errors[names.index(estimator)] if estimator in names else None
