"""Where answers about a machine turn over: what is too coarse, what counts, what is a line."""

import numpy as np
import pytest
from scipy.optimize import brentq

import rotorid as rid
from rotorid import InputError
from rotorid.results import machine
from rotorid.results.balancing import Balance, Masses, _nearest, _too_coarse, chosen
from rotorid.results.export import _solved
from rotorid.results.modes import whirl_of

ENDS = ["F_xa,F_ya", "F_xb,F_yb"]
PAIR = [(0, 1)]


def rigid(**values: float) -> rid.Estimate:
    """Return an estimate of the shipped rigid rotor."""
    model = rid.load_model("rigid")
    found = tuple(
        rid.Value(p.name, p.unit, values.get(p.name, p.nominal), 1e-3 * p.nominal)
        for p in model.parameters
    )
    spread = np.diag([value.std**2 for value in found])
    return rid.Estimate("rigid", "ml", "ok", found, covariance=spread)


@pytest.mark.parametrize(("width", "whirl"), [(0.019, "planar"), (0.021, "forward")])
def test_a_narrow_orbit_is_a_line(width: float, whirl: str) -> None:
    assert whirl_of(np.array([1.0, -1j * width]), PAIR, np.ones(2), 100.0) == whirl


@pytest.mark.parametrize(("share", "whirl"), [(0.019, "forward"), (0.021, "mixed")])
def test_a_place_that_hardly_moves_does_not_say_how_a_mode_whirls(share: float, whirl: str) -> None:
    inertia = np.array([1 - share, 1 - share, share, share])
    shape = np.array([1.0, -1j, 1.0, 1j])
    assert whirl_of(shape, [(0, 1), (2, 3)], inertia, 100.0) == whirl


@pytest.mark.parametrize(("left", "told"), [(0.099, 0), (0.101, 1)])
def test_masses_that_leave_a_tenth_are_too_coarse(left: float, told: int) -> None:
    ideal = np.array([2e-4 * np.exp(0.3j)])
    kit = Masses.of(0.1, ["1 g"], None)
    assert len(_too_coarse(["x,y"], (1 - left) * ideal, ideal, kit)) == told


@pytest.mark.slow
@pytest.mark.parametrize(("share", "graded"), [(0.19, True), (0.21, False)])
def test_a_plane_that_leaves_a_fifth_gives_no_grade(share: float, graded: bool) -> None:
    nominal = rid.load_model("rigid").nominal

    def one_plane(couple: float) -> Balance:
        less = {name: couple * nominal[name] for name in ("mu", "eta")}
        return rid.balance(rigid(**less), ["x + 0.001*theta_y, y - 0.001*theta_x"], "6000 rpm")

    couple = brentq(lambda c: one_plane(c).share - share, 0.0, 3.0, xtol=1e-6)
    assert (one_plane(couple).grade_mm_s is not None) == graded


@pytest.mark.parametrize(("apart", "told"), [(5e-7, False), (8e-7, True)])
def test_planes_that_nearly_coincide_are_one(apart: float, told: bool) -> None:
    planes = [f"x + {a}*theta_y, y - {a}*theta_x" for a in (0.2, 0.2 + apart)]
    if told:
        assert len(rid.balance(rigid(), planes, "6000 rpm").corrections) == 2
    else:
        with pytest.raises(InputError, match="planes of which one does what others do"):
            rid.balance(rigid(), planes, "6000 rpm")


def test_masses_go_where_hands_can_put_them() -> None:
    """Two masses for three quarters of both stand 41.41 degrees beside it: on whole degrees, 41."""
    kit = Masses.of(0.1, ["1 g"], None)
    ideal = 1.5e-4 * np.exp(0.2j)
    _, (mounted,) = chosen(kit, np.array([ideal]), (np.eye(1), np.array([-ideal])))
    beside = sorted(np.degrees(angle - 0.2) for _, angle in mounted)
    assert beside == pytest.approx([-41, 42]) or beside == pytest.approx([-41, 41])
    assert len(_nearest(kit, ideal)) == 24  # are tried with those of the other planes


def test_more_masses_than_are_tried_in_a_second_are_refused() -> None:
    sizes = [f"{k} g" for k in range(1, 11)]
    assert Masses.of(0.1, sizes, 400).holes == 400
    with pytest.raises(InputError, match=r"10 masses in 401 places; expected 4000 choices"):
        Masses.of(0.1, sizes, 401)


@pytest.mark.parametrize(("away", "solved"), [(2e-12, False), (8e-12, True)])
def test_a_matrix_is_singular_to_rounding(away: float, solved: bool) -> None:
    """Two equations that differ by this share have a reciprocal condition of a quarter of it."""
    of = machine.machine_of(rigid())
    matrix = np.array([[1.0, 1.0], [1.0, 1.0 - away]])
    if solved:
        assert np.isfinite(_solved(of, matrix, np.eye(2))).all()
    else:
        with pytest.raises(InputError, match="that is singular"):
            _solved(of, matrix, np.eye(2))
