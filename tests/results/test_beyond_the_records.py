"""What is assumed at speeds of which there is no record: how far it moves what follows."""

import json
from dataclasses import replace

import numpy as np
import pytest
from linear_machines import SUPPORTED, estimate_of, model_of
from model_text import model_text

import rotorid as rid
from rotorid.answer.parts import Shift
from rotorid.cli import run
from rotorid.models.structure import holding
from rotorid.testing import add_noise, line_record

RPM = np.pi / 30
SEAL = model_text(
    "A disc on a shaft with a seal that couples x and y",
    [
        "m*x'' + c*x' + k*x + q*y = F_x + m*Omega^2*(xi*cos(phi) - zeta*sin(phi))",
        "m*y'' + c*y' + k*y - q*x = F_y + m*Omega^2*(xi*sin(phi) + zeta*cos(phi))",
    ],
    "x m, y m",
    "F_x N, F_y N",
    "m 5.0 kg, c 400.0 N s/m, k 3e5 N/m, q 2e4 N/m, xi 1e-5 m, zeta 2e-5 m",
)
MODEL = rid.parse_model(SEAL, name="seal")


def identified(*rpm, model=MODEL, fixed=()):
    """Return the answer of records at some speeds."""
    rng, records = np.random.default_rng(3), []
    for speed in rpm:
        harmonics = sorted({3, 5, 8, 11, 14, 18, 22, round(speed / 60)})
        forces = 40 * np.exp(2j * np.pi * rng.uniform(size=(len(harmonics), len(model.inputs))))
        record = line_record(
            model,
            [model.nominal[name] for name in model.parameter_names],
            forces,
            harmonics=harmonics,
            fundamental=1.0,
            sample_rate=1000.0,
            periods=60,
            speed=speed * RPM,
        )
        units = {name: 0.3 if name in model.inputs else 3e-7 for name in record.names}
        records.append(add_noise(record, units, rng))
    known = {name: model.nominal[name] for name in fixed}
    begin = {name: value for name, value in model.nominal.items() if name not in known}
    return rid.identify(model, records, rid.MaximumLikelihood(start=begin, fixed=known))


@pytest.fixture(scope="module")
def one():
    return identified(900)


@pytest.fixture(scope="module")
def two():
    return identified(900, 2520)


def moved(notes, name, std):
    """Return how far a growth of a value with the speed may move what has that std."""
    return std * next((n.value for n in notes if n.about == f"{name} over the speed"), 0.0)


def test_a_critical_speed_far_from_the_record_holds_under_assumptions(one, two):
    (first, _) = rid.campbell(one, "3000 rpm").critical
    assert first.notes[0].about == "k over the speed"
    assert first.notes[0].value > 10
    assert "a record near that speed" in first.notes[0].cure
    assert first.std_assumed > first.notes[0].value * first.std
    within = rid.campbell(two, "3000 rpm").critical
    assert [(each.notes, bool(np.isnan(each.std_assumed))) for each in within] == 2 * [((), True)]


def test_the_shift_is_that_of_a_seal_that_stiffens(one):
    first = rid.campbell(one, "3000 rpm").critical[0]
    speed = first.speed_rad_s
    for _ in range(9):  # until it is the one that the stiffness there makes critical
        grown = 1 + 0.1 * (1 - (900 * RPM / speed) ** 2)
        values = (
            replace(v, value=v.value * (grown if v.name == "k" else 1)) for v in one.parameters
        )
        there = rid.modes(one.with_(parameters=tuple(values)), speed=speed)
        speed = 2 * np.pi * there.modes[0].frequency_hz
    shift = moved(first.notes, "k", first.std)
    assert shift == pytest.approx(speed - first.speed_rad_s, rel=0.03)


def test_records_at_two_speeds_bound_what_a_value_does_beyond(one, two):
    far = [rid.modes(each, speed="5000 rpm") for each in (one, two)]
    alone, both = (moved(each.notes, "k", each.modes[0].std_hz) for each in far)
    assert 0 < both < 0.01 * alone
    assert rid.modes(two, speed="5000 rpm").notes[0].about != "k over the speed"


@pytest.mark.parametrize(
    ("rpm", "beyond"), [(899, True), (899.5, False), (900.5, False), (901, True)]
)
def test_what_is_assumed_counts_from_the_speeds_of_the_records_on(one, rpm, beyond):
    (mode, _) = rid.modes(one, speed=rpm * RPM).modes
    assert np.isfinite([mode.std_assumed_hz, mode.damping_std_assumed]).tolist() == 2 * [beyond]


def test_shafts_masses_and_lengths_do_not_follow_the_speed():
    held = {"jeffcott": ("c", "k"), "three-mass": (), "flexible": (), "rigid": ()}
    for name, expected in held.items():
        model = rid.load_model(name)
        assert holding(model, model.values(model.nominal)) == expected
    tilting = model_of(SUPPORTED)
    assert holding(tilting, tilting.values(tilting.nominal)) == ("k_x", "k_y", "c", "d")


def test_a_lever_that_springs_make_up_for_moves_no_frequency():
    text = model_text(
        "tilting",
        ["J*tilt'' + d*tilt' + L^2*k*tilt = T"],
        "tilt rad",
        "T N m",
        "J 0.2 kg m^2, d 8.0 N m s, k 4e5 N/m, L 0.25 m",
    )
    found = identified(0, model=rid.parse_model(text), fixed=["L"])
    assert found["k"].std_assumed > 0.019 * found.value("k")
    assert "L" in [each.assumed for each in found.assumptions]
    about = {note.about for note in rid.modes(found, speed="3000 rpm").notes}
    assert about & {"L", "k over the speed"} == {"k over the speed"}


def test_the_command_says_so_and_strict_ends_with_it(one, tmp_path, capsys):
    result, told = tmp_path / "one.json", tmp_path / "modes.json"
    one.save(result)
    assert rid.load_estimate(result) == one
    given = ["modes", str(result), "--strict", "--speed"]
    assert run([*given, "900 rpm"]) == 0
    assert "assum" not in capsys.readouterr().out
    assert run([*given, "2440 rpm", "--to", "3000 rpm", "--json", str(told)]) == 3
    said = capsys.readouterr().out
    assert said.startswith("ok under assumptions: ")
    assert "note, k over the speed: " in said
    assert said.count("if assumptions err") == 4
    data = json.loads(told.read_text())
    assert (data["verdict"], data["status"]) == ("ok under assumptions", "ok")
    first = data["critical_speeds"][0]
    assert first["std_assumed"] > 10 * first["std"]
    assert data["modes"][0]["std_assumed_hz"] > 0
    balance = ["balance", str(result), "--plane", "x,y", "--strict", "--speed"]
    assert [run([*balance, speed]) for speed in ("900 rpm", "2440 rpm")] == [0, 3]
    said = capsys.readouterr().out
    assert said.count("seal: ok under assumptions") == said.count("if assumptions err") == 1


def test_what_follows_from_a_doubtful_result_is_doubtful(one, tmp_path, capsys):
    doubtful = one.with_notes(rid.Note("direction", "doubts", "off", on=("k",), value=5.0))
    assert doubtful.verdict == "doubtful"
    doubtful.save(result := tmp_path / "one.json")
    for command in (["modes"], ["balance", "--plane", "x,y"]):
        given = [command[0], str(result), *command[1:], "--speed", "900 rpm"]
        assert run([*given, "--strict"]) == 3
        assert "doubtful (5 std off along k)" in capsys.readouterr().out
        told = tmp_path / f"{command[0]}.json"
        assert run([*given, "--json", str(told)]) == 0
        data = json.loads(told.read_text())
        assert (data["verdict"], data["status"]) == ("doubtful", "ok")
    assert rid.campbell(doubtful, "3000 rpm").verdict == "doubtful"


def figures(found):
    """Return what follows from a result at 700 rad/s, and how far it may move by what it says."""
    modes = rid.modes(found, speed=700.0).modes
    critical = rid.campbell(found, 2000.0).critical
    response = rid.unbalance_response(found, 700.0)
    (added,) = rid.balance(found, ["x,y"], 700.0).corrections
    loops = rid.loop_sensitivity(
        found,
        lambda omega: -((4e4 + 100j * omega) * np.exp(-5e-4j * omega))[:, None, None],
        np.arange(1.0, 300.0, 0.5),
        sensors=["theta_x"],
        speed=700.0,
    )
    pairs = [
        *((mode.frequency_hz, mode.std_assumed_hz) for mode in modes),
        *((mode.damping_ratio, mode.damping_std_assumed) for mode in modes),
        *((each.speed_rad_s, each.std_assumed) for each in critical),
        *zip(np.abs(response.motion[0, :2]), response.std_assumed[0, :2], strict=True),
        (added.unbalance_kg_m, added.std_assumed_kg_m),
        (loops.axes[0].peak, loops.peak_std_assumed[0]),
    ]
    return np.array(pairs).T


def test_what_errors_move_is_what_follows_from_moved_values():
    free, held = {"m": 8e-3, "k_x": -2e2, "xi": 1e-8, "d": 1e-3}, {"L": 2.5e-5}
    base = estimate_of(model_of(SUPPORTED), percent=0.1, fixed=("L",))
    moves = {name: (by,) for name, by in (free | held).items()}
    shift = Shift("what is wrong", "1", "exact", "measure it", moves)
    found = base.with_(shifts=(shift,), speeds=(100.0, 300.0))
    values = (replace(v, value=v.value + (free | held).get(v.name, 0.0)) for v in base.parameters)
    here, told = figures(found)
    there, _ = figures(base.with_(parameters=tuple(values)))
    assert told == pytest.approx(np.abs(there - here), rel=0.02, abs=1e-10)
    within, none = figures(found.with_(speeds=(100.0, 2000.0)))
    assert within == pytest.approx(here)
    assert np.isnan(none).all()
