"""Eigenvalues of the quadratic pencil against closed forms and numpy's."""

import numpy as np
import pytest

from rotorid import load_model
from rotorid.models import modal
from rotorid.models.modal import _scales, eigenmodes, parted

CHAIN_M = np.diag([2.0, 3.0, 1.5])
CHAIN_K = np.array([[1.5e6, -1e6, 0], [-1e6, 3e6, -2e6], [0, -2e6, 2e6]])
CHAIN_D = np.array([[30.0, -20, 0], [-20, 45, -25], [0, -25, 25]])


def reference(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return lambda with positive imaginary part, from the state matrix."""
    n = len(mass)
    lower = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    values = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower]))
    kept = values[values.imag > 1e-3 * np.abs(values).max()]
    return kept[np.argsort(kept.imag)]


def test_eigenvalues_and_vectors_of_a_damped_chain() -> None:
    found = eigenmodes(CHAIN_M, CHAIN_D, CHAIN_K)
    np.testing.assert_allclose(found.values, reference(CHAIN_M, CHAIN_D, CHAIN_K), rtol=1e-10)
    for value, right, left in zip(found.values, found.right, found.left, strict=True):
        pencil = value**2 * CHAIN_M + value * CHAIN_D + CHAIN_K
        size = np.abs(value**2 * CHAIN_M).max()
        assert np.abs(pencil @ right).max() < 1e-10 * size * np.abs(right).max()
        assert np.abs(left.conj() @ pencil).max() < 1e-10 * size * np.abs(left).max()


def test_other_units_and_another_order_of_the_equations_change_nothing() -> None:
    row, column = np.array([1e6, 1e-5, 1.0]), np.array([1.0, 1e-7, 1e4])
    order = [2, 0, 1]
    other = eigenmodes(*((row[:, None] * m * column)[order] for m in (CHAIN_M, CHAIN_D, CHAIN_K)))
    np.testing.assert_allclose(other.values, reference(CHAIN_M, CHAIN_D, CHAIN_K), rtol=1e-9)


def test_the_paper_rotor_at_its_speed() -> None:
    model = load_model("three-mass")
    assert model.linear is not None
    m = model.linear.matrices(model.values(model.nominal), 2 * np.pi * 140)
    found = eigenmodes(m.M, m.D + 2 * np.pi * 140 * m.G, m.K)
    hertz = [found.values[group].mean().imag / (2 * np.pi) for group in found.distinct]
    np.testing.assert_allclose(hertz, [36.85, 175.53, 340.32, 569.29], atol=0.006)  # theory, 1
    assert [len(group) for group in found.distinct] == [1, 2, 1, 1]


def test_rigid_body_modes_and_overdamped_poles_are_no_modes() -> None:
    free = CHAIN_K - np.diag([5e5, 0, 0])
    assert len(eigenmodes(CHAIN_M, np.zeros((3, 3)), free).values) == 2
    single = [np.array([[1.0]]), np.array([[2.1]]), np.array([[1.0]])]
    assert len(eigenmodes(*single).values) == 0
    assert len(eigenmodes(single[0], 0.9 * single[1], single[2]).values) == 1


def test_a_soft_mode_is_no_rigid_body_mode() -> None:
    def count(soft: float) -> int:
        stiffness = CHAIN_K - np.diag([5e5, 0, 0]) + np.diag([soft, 0, 0])
        return len(eigenmodes(CHAIN_M, np.zeros((3, 3)), stiffness).values)

    assert count(1e-3) == 3
    assert count(3e-7) == 3  # a share of 3e-14 of the others: FREE is 1e-14
    assert count(1e-8) == 2  # rounding leaves 1e-10 of a sum of 1e6


def test_a_support_that_is_rigid_hides_no_soft_one() -> None:
    """Beside 1e18 N/m a mode on 400 N/m has a share of 2e-8 of the highest frequency."""
    stiffness = np.diag([1e18, 400.0])
    found = eigenmodes(np.eye(2), np.zeros((2, 2)), stiffness)
    assert found.rigid == 0
    np.testing.assert_allclose(found.values.imag, [20.0, 1e9], rtol=1e-12)


def test_zero_is_a_double_pole_but_where_damping_acts() -> None:
    free = CHAIN_K - np.diag([5e5, 0, 0])
    internal = CHAIN_D - np.diag([10.0, 0, 0])
    assert eigenmodes(CHAIN_M, internal, free).rigid == 2
    dragged = eigenmodes(CHAIN_M, internal + np.diag([1e-9, 0, 0]), free)  # UNDAMPED: 4e-11 > 1e-12
    assert (dragged.rigid, len(dragged.real)) == (1, 1)
    assert eigenmodes(CHAIN_M, internal + np.diag([1e-12, 0, 0]), free).rigid == 2


def test_what_counts_as_real_and_as_one() -> None:
    for imaginary, count in ((1e-4, 1), (1e-9, 0)):
        ratio = np.sqrt(1 - imaginary**2)
        damped = [np.array([[1.0]]), np.array([[2 * ratio]]), np.array([[1.0]])]
        assert len(eigenmodes(*damped).values) == count
    for apart, count in ((1e-6, 2), (1e-12, 1)):
        stiffness = np.diag([1e6, 1e6 * (1 + apart)])
        assert len(eigenmodes(np.eye(2), np.zeros((2, 2)), stiffness).distinct) == count


def test_massless_coordinates_have_no_mode() -> None:
    found = eigenmodes(np.diag([2.0, 0.0]), np.zeros((2, 2)), np.array([[2.0, -1], [-1, 3]]))
    np.testing.assert_allclose(found.values, [1j * np.sqrt((2 - 1 / 3) / 2)], rtol=1e-10)


def test_a_machine_beyond_all_bounds_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="beyond all bounds"):
        eigenmodes(np.array([[np.inf]]), np.zeros((1, 1)), np.eye(1))


def test_coinciding_frequencies_part_as_their_planes_do() -> None:
    # two planes of one mass; unknowns: their stiffnesses. d omega = dk / (2 m omega), each its own
    found = eigenmodes(np.diag([2.0, 2.0]), np.zeros((2, 2)), np.diag([8.0, 8.0]))
    gram = found.left.conj() @ (2 * 2j * np.diag([2.0, 2.0])) @ found.right.T
    slopes = found.left.conj()[:, None, :] * found.right[None, :, :]
    away = parted(gram, slopes.astype(complex), np.array([1.0, -0.3])).imag
    np.testing.assert_allclose(away, [[0, 1 / 8], [1 / 8, 0]], atol=1e-12)


@pytest.mark.parametrize("complex_stiffness", [False, True])
def test_both_ways_to_the_poles_agree(monkeypatch, complex_stiffness):
    """M divided by, and the pencil of two matrices, which a coordinate without inertia needs."""
    model = load_model("three-mass")
    assert model.linear is not None
    m = model.linear.matrices(model.values(model.nominal), 2 * np.pi * 140)
    held = m.K + np.diag([1e4] * 8) * (1 + 0.02j * complex_stiffness)
    matrices = (m.M, m.D + 2 * np.pi * 140 * m.G + np.diag([3.0] * 8), held)
    fast = eigenmodes(*matrices)
    assert modal.eigenvalues(*matrices) == pytest.approx(fast.values, rel=1e-12)
    monkeypatch.setattr(modal, "REGULAR", 0.0)
    slow = eigenmodes(*matrices)
    assert modal.eigenvalues(*matrices) == pytest.approx(slow.values, rel=1e-10)
    assert fast.values == pytest.approx(slow.values, rel=1e-10)
    for one, two in zip(fast.right, slow.right, strict=True):
        assert abs(np.vdot(one, two)) ** 2 == pytest.approx(
            (np.vdot(one, one) * np.vdot(two, two)).real, rel=1e-9
        )
    for value, left in zip(fast.values, fast.left, strict=True):
        rest = left.conj() @ (value**2 * matrices[0] + value * matrices[1] + matrices[2])
        assert np.abs(rest).max() < 1e-8 * (np.abs(left) @ np.abs(held)).max()
    massless = np.diag([1.0, 0.0])
    found = eigenmodes(massless, np.diag([0.1, 0.0]), np.array([[3.0, -1.0], [-1.0, 1.0]]))
    assert found.values.imag == pytest.approx(np.sqrt(2 - 0.05**2), rel=1e-12)


def test_scaling_goes_as_far_as_it_needs_to() -> None:
    """A matrix that no scaling levels: a sweep halves what is left; after 8 it is 10 %."""
    size = np.array([[1.0, 1e12], [0.0, 1.0]])
    row, column = _scales(size)
    least = float((row[:, None] * size * column).max(axis=0).min())
    assert 0.8 < least < 0.95
