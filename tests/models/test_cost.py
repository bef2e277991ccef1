"""Texts that ask for too much: refused by counting, before the work, in one line."""

import pytest
from bank import table

from rotorid import Model, ModelError, load_model, parse_model, shipped_models
from rotorid.models import text_cost
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


def roots(depth: int) -> str:
    text = "x"
    for _ in range(depth):
        text = f"({text}+x)^(1/3)"
    return text


def dense(digits: int, size: int) -> list[str]:
    """Return equations whose elimination has numbers of more and more digits."""
    figure = [str(pow(7, 40 + 3 * i, 10**digits)) for i in range(size * size)]
    return [
        " + ".join(f"0.{figure[size * i + j]}*p{j}*x" for j in range(size)) + " = 0"
        for i in range(size)
    ]


@pytest.fixture
def spent(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """What is spent while a test runs."""
    found, spend = [0], text_cost.spend

    def counted(units: int) -> None:
        found[0] += units
        spend(units)

    monkeypatch.setattr(text_cost, "spend", counted)
    return found


@pytest.mark.parametrize(
    ("term", "limit"),
    [
        (roots(17), f"nesting deeper than {text_cost.NESTED}"),
        ("sin(" * 12 + "x" + ")" * 12, f"nesting deeper than {text_cost.NESTED}"),
        ("(1.1^300)^300*x", f"more than {text_cost.DIGITS} digits"),
        ("1.1^300*1.3^300*1.7^300*1.9^300*x", "more than 1000 digits"),
        ("x*" + "*".join(["1.23456789012345678901234567890123456789"] * 30), "digits"),
        (" + ".join(f"x/{10**9 + 7 + 2 * i}" for i in range(300)), "digits"),
        ("(x+t+phi+Omega)^31.5", "too many terms"),
        ("(x+t+phi+Omega)^(-31)", "too many terms"),
        ("1/(x+t+phi+Omega)^31", "too many terms"),
        ("x*(" + "+".join(f"cos(pi/{i})" for i in range(7, 20)) + ")^31", "too many terms"),
        ("(" + "+".join(f"tanh(x+{i})" for i in range(60)) + ")^2*(x+t+phi)", "too many|steps"),
        ("x^999999999999999999999999", "degree"),
        ("2^(999999999999999999999999)*x", "degree"),
        ("x^32*x", "degree"),
    ],
)
def test_a_bomb_is_one_line_that_names_the_limit(term: str, limit: str, spent: list[int]) -> None:
    with pytest.raises(ModelError, match=limit) as found:
        model_of(term)
    assert "equation 1" in str(found.value)
    assert len(str(found.value)) < 600
    assert spent[0] < text_cost.WORK + 50_000  # what is refused last is not done any more


@pytest.mark.slow
def test_equations_share_what_they_may_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Terms that cancel are counted as well, in the algebra and out of it."""
    monkeypatch.setattr(text_cost, "WORK", 50_000)
    powers = "(m+c+k+x+x')^4*(x+1)"
    with pytest.raises(ModelError, match=r"equation \d\d: found equations that take more than"):
        model_of("x", *[f"{powers} - {powers} + m*x'' = 0"] * 99)
    with pytest.raises(ModelError, match="steps to expand"):
        model_of(" + ".join(f"sin({i}*x+t)" for i in range(150)))
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
def test_a_hundred_coordinates(spent: list[int]) -> None:
    """A chain of masses; with friction that is not linear it takes the algebra."""
    count = 100

    def equation(i: int) -> str:
        left, right = (i - 1) % count, (i + 1) % count
        return (
            f"m{i}*x{i}'' + k{i}*(x{i}-x{right}) + k{left}*(x{i}-x{left}) + c{i}*(x{i}'-x{right}')"
            f"+ c{left}*(x{i}'-x{left}') + g*Omega*x{(i + 50) % count}'"
            f"+ m{i}*u{i}*Omega^2*cos(phi) + m{i}*u{i}*Omega^2*sin(phi)"
        )

    def model(more: str, on: int = 0) -> Model:
        return parse_model(
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

    assert len(model("").terms) == 1200
    assert spent[0] < text_cost.WORK / 30
    spent[0] = 0
    assert len(model(" + c0*tanh(x0'/0.01)", on=5).terms) == 1205
    assert spent[0] < text_cost.WORK / 10


def test_the_limits_are_where_they_are_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    model_of(roots(8))
    with pytest.raises(ModelError, match="8 levels at most"):
        model_of(roots(9))
    model_of("x*1.1234567891^97")  # a denominator of 971 digits
    with pytest.raises(ModelError, match="1000 digits"):
        model_of("x*1.1234567891^101")
    monkeypatch.setattr(text_cost, "WORK", 5_000)
    model_of("x" + "+x" * 1_600)
    with pytest.raises(ModelError, match="more than 5,000 steps"):
        model_of("x" + "+x" * 1_700)


@pytest.mark.parametrize(
    ("term", "units"),
    [("x", 25), ("(k+x)*(k+x)", 47), ("sqrt(x+1)", 1214), ("tanh(x+1)", 1214)],
)
def test_what_a_step_counts(term: str, units: int, spent: list[int]) -> None:
    model_of(term)
    assert spent[0] == units
