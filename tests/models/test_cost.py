"""Texts that ask for too much: refused by counting, before the work, in one line."""

import pytest
from bank import table

from rotorid import Model, ModelError, load_model, parse_model, shipped_models
from rotorid.models import text
from rotorid.models.equations import polynomial


def model_of(term: str, *more: str, names: int = 0) -> Model:
    extra = [f"p{i}" for i in range(names)]
    return parse_model(
        table(
            "large",
            [f"m*x'' + c*x' + k*x + {term} = F", *more],
            coordinates={"x": "m"},
            inputs={"F": "N"},
            parameters=dict.fromkeys(["m", "c", "k", *extra], "kg"),
        )
    )


def dense(digits: int, size: int) -> list[str]:
    """Return equations whose elimination has numbers of more and more digits."""
    figure = [str(pow(7, 40 + 3 * i, 10**digits)) for i in range(size * size)]
    return [
        " + ".join(f"0.{figure[size * i + j]}*p{j}*x" for j in range(size)) + " = 0"
        for i in range(size)
    ]


def squared(levels: int) -> str:
    """Return functions of sums of functions, whose size grows with each level."""
    found = "x"
    for _ in range(levels):
        found = f"sin(({found}+1)^8)"
    return found


@pytest.fixture
def spent(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """What is spent while a test runs."""
    found, spend = [0], text.Work.spend

    def counted(work: text.Work, units: int) -> None:
        found[0] += units
        spend(work, units)

    monkeypatch.setattr(text.Work, "spend", counted)
    return found


@pytest.mark.parametrize(
    ("term", "limit"),
    [
        (squared(20), "steps to expand"),
        ("(1.1^300)^300*x", f"more than {text.DIGITS} digits"),
        ("1.1^300*1.3^300*1.7^300*1.9^300*x", "more than 1000 digits"),
        ("x*" + "*".join(["1.23456789012345678901234567890123456789"] * 30), "digits"),
        (" + ".join(f"x/{10**9 + 7 + 2 * i}" for i in range(300)), "digits"),
        ("1/(x+t+phi+Omega)^31", "too many terms"),
        ("x*(" + "+".join(f"cos(pi/{i})" for i in range(7, 20)) + ")^31", "too many terms"),
        ("(" + "+".join(f"tanh(x+{i})" for i in range(60)) + ")^2*(x+t+phi)", "too many|steps"),
        ("x^999999999999999999999999", "degree"),
        ("2^(999999999999999999999999)*x", "degree"),
        ("2^(999999999999999999999999.5)*x", "degree"),
        ("x^32*x", "degree"),
    ],
)
def test_a_bomb_is_one_line_that_names_the_limit(term: str, limit: str, spent: list[int]) -> None:
    with pytest.raises(ModelError, match=limit) as found:
        model_of(term)
    assert "equation 1" in str(found.value)
    assert len(str(found.value)) < 600
    assert spent[0] < 2 * text.WORK  # what is refused last is not done any more


@pytest.mark.slow
def test_equations_share_what_they_may_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Terms that cancel are counted as well."""
    monkeypatch.setattr(text, "WORK", 50_000)
    powers = "(m+c+k+x+x')^4*(x+1)"
    with pytest.raises(ModelError, match=r"equation \d\d: found equations that take more than"):
        model_of("x", *[f"{powers} - {powers} + m*x'' = 0"] * 99)
    model_of("p0*x", *dense(6, 12), names=12)
    with pytest.raises(ModelError, match="steps to expand"):
        model_of("p0*x", *dense(40, 25), names=25)


def test_a_combination_costs_less_than_a_model() -> None:
    names = [f"x{i}" for i in range(100)]
    assert len(polynomial(" + ".join(f"0.5*{name}" for name in names), names)) == 100
    with pytest.raises(ModelError, match="more than 20,000 steps"):
        polynomial("x0" + "+x1" * 7_000, names)
    with pytest.raises(ModelError, match="more than 20,000 steps"):
        polynomial("+".join(f"(x{i % 100}+1)/(1+1)" for i in range(3_000)), names)


def test_honest_models_cost_little(spent: list[int]) -> None:
    for name in shipped_models():
        spent[0] = 0
        load_model(name)
        assert spent[0] < 5_000, name


@pytest.mark.slow
@pytest.mark.parametrize(("more", "on"), [("", 0), (" + c0*tanh(x0'/0.01)", 5)])
def test_a_hundred_coordinates(more: str, on: int, spent: list[int]) -> None:
    """A chain of masses, also with friction that is not linear."""
    count = 100

    def equation(i: int) -> str:
        left, right = (i - 1) % count, (i + 1) % count
        return (
            f"m{i}*x{i}'' + k{i}*(x{i}-x{right}) + k{left}*(x{i}-x{left}) + c{i}*(x{i}'-x{right}')"
            f"+ c{left}*(x{i}'-x{left}') + g*Omega*x{(i + 50) % count}'"
            f"+ m{i}*u{i}*Omega^2*cos(phi) + m{i}*u{i}*Omega^2*sin(phi)"
        )

    model = parse_model(
        table(
            "chain",
            [f"{equation(i)}{more * (i < on)} = F{i}" for i in range(count)],
            coordinates={f"x{i}": "m" for i in range(count)},
            inputs={f"F{i}": "N" for i in range(count)},
            parameters=dict.fromkeys(
                ["g", *(p + str(i) for p in "mkcu" for i in range(count))], "kg"
            ),
        )
    )
    assert len(model.terms) == 1200 + on
    assert spent[0] < text.WORK / 20


def test_the_limits_are_where_they_are_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    model_of("x*1.1234567891^97")  # a denominator of 971 digits
    with pytest.raises(ModelError, match="1000 digits"):
        model_of("x*1.1234567891^101")
    monkeypatch.setattr(text, "WORK", 5_000)
    model_of("x" + "+x" * 1_600)
    with pytest.raises(ModelError, match="more than 5,000 steps"):
        model_of("x" + "+x" * 1_700)
