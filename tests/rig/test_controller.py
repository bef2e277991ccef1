"""Controllers: PID, and what python-control and scipy bring."""

import importlib.util
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from scipy import signal

from rotorid import InputError, load_rig
from rotorid.rig.controller import Controller, as_controller, pid, side_by_side
from rotorid.rig.rig import growth

T = 1e-4


def test_pid_is_its_transfer_function() -> None:
    """-(P + I T / (z - 1) + D (1 - a) / T (z - 1) / (z - a)), a = exp(-2 pi f T)."""
    gain, reset, rate, f = 3e3, 2e5, 7.0, 1500.0
    omega = 2 * np.pi * np.array([1.0, 10.0, 200.0, 4000.0])
    z, a = np.exp(1j * omega * T), np.exp(-2 * np.pi * f * T)
    expected = -(gain + reset * T / (z - 1) + rate * (1 - a) / T * (z - 1) / (z - a))
    np.testing.assert_allclose(
        pid(gain, reset, rate, f, T).response(omega)[:, 0, 0], expected, rtol=1e-10
    )


def test_pid_approaches_the_continuous_one_at_low_frequency() -> None:
    omega = np.array([2 * np.pi * 5.0])
    found = pid(3e3, 2e5, 7.0, 1500.0, T).response(omega)[0, 0, 0]
    expected = -(3e3 + 2e5 / (1j * omega[0]) + 7.0 * 1j * omega[0])
    assert found == pytest.approx(expected, rel=5e-3)


def test_pid_without_integral_has_no_integrator() -> None:
    assert pid(1.0, 0.0, 1.0, 100.0, T).states == 1
    assert pid(1.0, 1.0, 1.0, 100.0, T).states == 2


def test_axes_side_by_side_do_not_know_of_one_another() -> None:
    axes = [pid(p, 10.0, 1.0, 500.0, T) for p in (1.0, 2.0, 3.0)]
    both = side_by_side(axes).response([100.0])[0]
    single = [axis.response([100.0])[0, 0, 0] for axis in axes]
    np.testing.assert_allclose(both, np.diag(single))
    assert axes[0].on_each(4).commands == 4


NUMERATOR, DENOMINATOR = [-2e4, 1.9e4], [1.0, -0.6, 0.05]
SPACE = ([[0.5, 0.1], [0.0, 0.2]], [[1.0], [0.5]], [[-1e4, 2.0]], [[-3e3]])
SYSTEMS = {
    "scipy transfer function": signal.dlti(NUMERATOR, DENOMINATOR, dt=T),
    "control transfer function": control.TransferFunction(NUMERATOR, DENOMINATOR, T),
    "scipy state space": signal.dlti(*SPACE, dt=T),
    "control state space": control.StateSpace(*SPACE, T),
    "control of unspecified period": control.StateSpace(*SPACE, True),
    "a controller": Controller(*SPACE, T),
}


@pytest.mark.parametrize("kind", SYSTEMS)
def test_systems_of_other_packages(kind: str) -> None:
    z = np.exp(1j * np.array([50.0, 3000.0]) * T)
    if "transfer" in kind:
        expected = np.polyval(NUMERATOR, z) / np.polyval(DENOMINATOR, z)
    else:
        a, b, c, d = map(np.array, SPACE)
        expected = [(c @ np.linalg.solve(x * np.eye(2) - a, b) + d)[0, 0] for x in z]
    found = as_controller(SYSTEMS[kind], T)
    np.testing.assert_allclose(found.response([50.0, 3000.0])[:, 0, 0], expected, rtol=1e-9)


def test_python_control_is_not_imported_by_the_package() -> None:
    code = (
        "import sys, rotorid.rig.file, rotorid.cli; "
        "from rotorid.rig.controller import as_controller; "
        "from scipy import signal; as_controller(signal.dlti([1.0], [1.0, 0.5], dt=1e-4), 1e-4); "
        "sys.exit('control' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: as_controller(signal.lti([1.0], [1.0, 1.0]), T), "discretize it at the contr"),
        (lambda: as_controller(control.tf([1.0], [1.0, 1.0]), T), "a continuous Transfer"),
        (lambda: as_controller(signal.dlti([1.0], [1.0, 0.5], dt=2e-4), T), "every 0.0002 s"),
        (lambda: as_controller("pid", T), "'pid'; expected a discrete system"),
        (lambda: Controller([[1.0]], [[1.0, 2.0]], [[1.0]], [[1.0]], T), r"B of shape \(1, 2\)"),
        (lambda: Controller([], [], [], [[np.nan]], T), "not finite"),
        (lambda: Controller([], [], [], [[1.0]], 0.0), "a period of 0.0 s"),
        (lambda: pid(1.0, 0.0, 1.0, 0.0, T), "filter_frequency: found 0.0 Hz"),
        (
            lambda: Controller([], [], [], np.eye(2), T).on_each(2),
            "2 positions, 2 commands; expected one of each",
        ),
        (
            lambda: side_by_side([Controller([], [], [], [[1.0]], t) for t in (T, 2 * T)]),
            "expected one period",
        ),
    ],
)
def test_bad_controllers_are_refused(build, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build()


def test_the_example_of_a_centralised_controller_holds_the_rotor_by_all_axes() -> None:
    path = Path(__file__).parents[2] / "examples" / "centralised_control.py"
    spec = importlib.util.spec_from_file_location("centralised_control", path)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    rig = load_rig("three-mass").rig
    controller = example.centralised(rig)
    assert (controller.positions, controller.commands) == (4, 4)
    held = replace(rig, controller=controller)
    assert growth(held, held.plant(1.0), rig.rotation.speed)[0] < 0
    # From one axis and end to the others: no four controllers side by side.
    across = np.abs(controller.response([2 * np.pi * 140.0])[0])
    assert across[0, 1:].min() > 1e-3 * across[0, 0]
    assert across[0, 3] > 0.05 * across[0, 0]
