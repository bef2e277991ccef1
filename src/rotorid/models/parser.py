"""Texts of equations and expressions, read to polynomials over atoms by recursive descent.

Nothing is ever evaluated as code. An atom is a name, or a root, a divisor or a function of a
polynomial; `pi`, roots of numbers and functions of numbers are atoms too. Signals that are the same
for other reasons (``sin^2 + cos^2 = 1``) are for `base` to find, by their values.

    equation = sum "=" sum
    sum      = product (("+" | "-") product)*
    product  = unary (("*" | "/") unary)*
    unary    = ("+" | "-")* power
    power    = atom (("^" | "**") unary)?
    atom     = number | name | function "(" sum ")" | "(" sum ")"
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction

from rotorid.core.errors import ModelError, nearest
from rotorid.models.expressions import (
    FUNCTIONS,
    TOLERANCE,
    Expression,
    Real,
    expression,
    is_number,
    number,
    product,
    simple_fraction,
    symbol,
    values_at,
)

MAX_LENGTH = 100_000
MAX_NESTING = 64
MAX_DEGREE = 32
MAX_TERMS = 5_000
MAX_EXPONENT = 280  # decimal exponent of a number
WORK = 500_000
"""Units of up to 4 us that all texts of a model may cost together: two seconds. A model of a
hundred coordinates and 1,200 terms costs 15,000; the shipped ones cost below 2,000."""
COMBINATION = 20_000
"""Units for what a sensor reads, or a constraint: 0.1 s, since an experiment may hold hundreds."""
PRODUCT = 2  # units for two terms that are multiplied
EVALUATED = 20  # units for a node that is evaluated to a hundred digits, at each of several points
DIGITS = 1_000
"""Of a numerator or denominator: more than any product of measured numbers needs, far below
where arithmetic with them takes time."""
EXACT_BITS = 400  # of a fraction from which on exact elimination takes more than a unit an entry
_POINTS = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1000, 1), (-1000, -1))
"""Scale and sign of the points at which a divisor is held against zero."""
_PRIMES = 1_000  # numbers below are taken out of a root
_TOKEN = re.compile(
    r"[ \t\f\r\n]*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[^\W\d]\w*'{0,2})|(?P<sign>\*\*|[-+*/^()=])|(?P<end>\Z)|(?P<none>.))",
    re.DOTALL,
)
Powers = frozenset[tuple[Expression, int | Fraction]]
Polynomial = dict[Powers, Fraction]
NUMBER: Powers = frozenset()


class Work:
    """What texts may cost together, counted before it is spent, and by no clock."""

    def __init__(self, units: int | None = None) -> None:
        self.units = self.left = WORK if units is None else units

    def spend(self, units: int) -> None:
        self.left -= units
        if self.left < 0:
            told = f"equations that take more than {self.units:,} steps to expand"
            cure = "simplify them, or give a large part of them a name and a parameter of its own"
            raise ModelError(told, "sums and products of a few thousand terms in all", cure)

    def spend_exact(self, row: Iterable[Fraction], factor: Fraction) -> None:
        """Count what it takes to multiply a row of fractions exactly, and take it from another."""
        bits = factor.numerator.bit_length() + factor.denominator.bit_length()
        for value in row:
            size = bits + value.numerator.bit_length() + value.denominator.bit_length()
            self.spend(1 + (size // EXACT_BITS) ** 2)


def read(
    text: str,
    names: frozenset[str],
    linear: frozenset[str] = frozenset(),
    *,
    equation: bool = False,
    work: Work | None = None,
) -> Polynomial:
    """Return the terms of an expression, or of an equation as left minus right side.

    `linear`: names that stand in no function, root or divisor. Coefficients hold the numbers.
    """
    _require_at_most(len(text), MAX_LENGTH, "{} characters", "split it into several equations")
    reader = _Reader(text, names, linear, Work() if work is None else work)
    return reader.with_numbers(reader.whole(equation))


def out_of_range(coefficient: Fraction) -> bool:
    return not 10**-MAX_EXPONENT < abs(coefficient) < 10**MAX_EXPONENT


def _alone(base: Expression, exponent: int | Fraction = 1) -> Polynomial:
    return {frozenset([(base, exponent)]): Fraction(1)}


def shown(value: Expression) -> str:
    text = str(value).replace("**", "^")
    return text if len(text) <= 60 else text[:57] + "..."


def _shown(polynomial: Polynomial) -> str:
    return shown(expression(polynomial))


class _Algebra:
    """Sums, products, powers and functions of polynomials, refused where too large or undefined."""

    def __init__(self, linear: frozenset[str], work: Work) -> None:
        self.linear, self.work = linear, work

    def add(self, total: Polynomial, other: Polynomial, sign: int = 1) -> None:
        """Add a polynomial to a total that no one else holds."""
        self.work.spend(len(other))
        for powers, coefficient in other.items():
            found = total.get(powers, Fraction(0)) + sign * coefficient
            _check_digits(found)
            if found:
                total[powers] = found
            else:
                del total[powers]
        _require_few(len(total))

    def times(self, one: Polynomial, other: Polynomial) -> Polynomial:
        pairs = len(one) * len(other)
        _require_few(pairs)
        self.work.spend(PRODUCT * pairs)
        total: Polynomial = {}
        for first, c in one.items():
            for second, d in other.items():
                powers = dict(first)
                for base, n in second:
                    powers[base] = powers.get(base, 0) + n
                for key, value in self._term(powers, c * d).items():
                    total[key] = total.get(key, Fraction(0)) + value
        for key, value in total.items():
            _check_digits(value)
            degree: int | Fraction = sum(max(n, -n) for base, n in key if base.free_symbols)
            _require_at_most(degree, MAX_DEGREE, "degree {}", "write it smaller")
        return {key: value for key, value in total.items() if value}

    def _term(self, powers: Mapping[Expression, int | Fraction], c: Fraction) -> Polynomial:
        """Return a product of powers: whole powers of numbers and of sums are multiplied out."""
        left, sums = [], []
        for base, n in powers.items():
            if is_number(base):
                ((_, value),), whole = base.parts, n // 1
                c, n = c * value**whole, n - whole
            if base.kind == "sum" and n > 0 and n == n // 1:
                inside = {frozenset(factors): value for factors, value in base.parts}
                sums.append(self.power(inside, Fraction(n)))
            elif n:
                left.append((base, n))
        found = {frozenset(left): c}
        for each in sums:
            found = self.times(found, each)
        return found

    def power(self, base: Polynomial, exponent: Fraction, what: str = "") -> Polynomial:
        """Return a power of a polynomial; `what` is what a message calls it."""
        size, moving = max(1, abs(int(exponent))), any(self._names(base))
        limit = MAX_DEGREE if moving else 300
        if size > limit:
            expected = f"a degree of at most {limit}"
            raise ModelError(f"the power {exponent}", expected, "write it smaller")
        if exponent.denominator == 1 and exponent >= 0:
            found: Polynomial = {NUMBER: Fraction(1)}
            if base.keys() == {NUMBER}:
                _check_digits(base[NUMBER], size)
            for _ in range(int(exponent)):
                found = self.times(found, base)
            return found
        what = what or f"the power {exponent} of"
        self._refuse_linear(base, what)
        if self._vanishes(base):
            expected = "a base or divisor other than zero"
            raise ModelError(f"{what} zero ({_shown(base)})", expected, "remove it")
        if len(base) > 1:
            return self._atom(expression(base), exponent)
        ((powers, c),) = base.items()
        return self._root(dict(powers), c, exponent)

    def _root(
        self, powers: dict[Expression, int | Fraction], c: Fraction, exponent: Fraction
    ) -> Polynomial:
        """Return a power, negative or no whole one, of a single term."""
        whole = exponent.denominator == 1
        found = _power_of_number(c if whole else abs(c), exponent)
        inside: dict[Expression, int | Fraction] = {}  # what may be negative
        for base, n in powers.items():
            if not whole and n % 2 == 0:
                base = Expression("abs", (base,))
                self._atom(base)
            elif not whole and n % 1 == 0 and (n != 1 or c < 0 or len(powers) > 1):
                inside[base] = n
                continue
            found = self.times(found, self._term({base: n * exponent}, Fraction(1)))
        if not whole and (c < 0 or inside):
            held = {frozenset(inside.items()): Fraction(1 if c > 0 else -1)}
            found = self.times(found, self._atom(expression(held), exponent))
        return found

    def call(self, function: str, argument: Polynomial) -> Polynomial:
        self._refuse_linear(argument, f"{function} of")
        if function == "sqrt":
            return self.power(argument, Fraction(1, 2)) if argument else {}
        rest = {key: c for key, c in argument.items() if self._names({key: c})}
        if function == "exp" and rest and len(rest) < len(argument):  # exp(x + 1000)
            size = {key: c for key, c in argument.items() if key not in rest}
            return self.times(self.call(function, size), self.call(function, rest))
        inner, sign = expression(argument), 1
        if function != "exp" and inner.kind == "sum" and inner.parts and inner.parts[0][1] < 0:
            inner = expression({key: -c for key, c in argument.items()})  # sin(-x) = -sin(x)
            sign = 1 if function in ("cos", "abs") else -1
        value = Expression(function, (inner,))
        found = self._atom(value)
        if not value.free_symbols:
            known = self._known(value)
            found = found if known is None else known
        return {key: sign * c for key, c in found.items() if c}

    def _atom(self, value: Expression, exponent: int | Fraction = 1) -> Polynomial:
        """Return a function, or a power of a sum, counted by what evaluating it takes."""
        self.work.spend(EVALUATED + value.nodes)
        found = _alone(value, exponent)
        if not value.free_symbols:
            _value_of(expression(found))
        return found

    def _known(self, value: Expression) -> Polynomial | None:
        """Return a function of a number where it is a fraction, or the root of one: cos(pi/4)."""
        size = _value_of(value)
        zero = abs(size) < 1e-90 and value.kind != "exp"  # sin(pi) is 1e-101
        for exponent in (1, 2):
            if (zero or 1e-20 < abs(size) < 1e20) and (
                simple := simple_fraction(size**exponent)
            ) is not None:
                found = _power_of_number(simple, Fraction(1, exponent)) if simple else {}
                return {key: -c if size < 0 and exponent == 2 else c for key, c in found.items()}
        return None

    def _vanishes(self, value: Polynomial) -> bool:
        """Tell whether a polynomial is zero whatever its symbols are."""
        if len(value) < 2 or all(bool(b.kind == "name") for powers in value for b, _ in powers):
            return not value
        terms = [expression({powers: c}) for powers, c in value.items()]
        names = sorted(self._names(value))
        size = sum(base.nodes for powers in value for base, _ in powers)
        self.work.spend(EVALUATED * size)
        for scale, sign in _POINTS:
            point = {
                name: Fraction((2 * i + 3) * (sign if i % 2 else 1), (7 * i + 11) * scale)
                for i, name in enumerate(names)
            }
            found = values_at(point, terms)
            if found is not None and abs(sum(found)) > TOLERANCE * max(map(abs, found)):
                return False
        return True

    def _names(self, value: Polynomial) -> set[str]:
        return {str(s) for powers in value for base, _ in powers for s in base.free_symbols}

    def _refuse_linear(self, value: Polynomial, what: str) -> None:
        held = sorted(self._names(value) & self.linear)
        if held:
            told = f"{what} {_shown(value)}, which holds {', '.join(held)}"
            expected = "a polynomial in the parameters, inputs to the first power only"
            raise ModelError(told, expected, "name the whole expression as a parameter of its own")

    def with_numbers(self, value: Polynomial) -> Polynomial:
        """Make atoms that are numbers part of the coefficients, as double precision has them."""
        groups: dict[Powers, Polynomial] = {}
        for powers, c in value.items():
            own = frozenset(factor for factor in powers if not factor[0].free_symbols)
            groups.setdefault(powers - own, {})[own] = c
        found: Polynomial = {}
        for powers, numbers in groups.items():
            if self._vanishes(numbers):
                continue
            total = Fraction(0)
            for own, c in numbers.items():
                for factor in own:
                    c *= Fraction(repr(float(_value_of(product([factor])))))
                total += c
            if out_of_range(total):
                told = f"{_shown(numbers)}, too large or too small a number"
                raise ModelError(told, f"1e+-{MAX_EXPONENT}", "scale it")
            found[powers] = total
        return found


class _Reader(_Algebra):
    """One text, token by token: `kind`, `word` and `place` are of the next one."""

    def __init__(
        self, text: str, names: frozenset[str], linear: frozenset[str], work: Work
    ) -> None:
        super().__init__(linear, work)
        self.text, self.names, self.nesting, self.equation = text, names, 0, False
        self.place = self.end = 0
        self._look()

    def whole(self, equation: bool) -> Polynomial:
        self.equation = equation
        found = self.sum()
        if equation:
            self.needs("=")
            self.add(found, self.sum(), -1)
        if self.kind != "end":
            raise self.unexpected()
        return found

    def _look(self) -> None:
        match = _TOKEN.match(self.text, self.end)
        assert match is not None
        self.kind = str(match.lastgroup)
        self.word, self.end = match[self.kind], match.end()
        self.place = match.start(self.kind) if self.word else self.place

    def taken(self) -> str:
        self.work.spend(1)
        word = self.word
        self._look()
        return word

    def accepts(self, *signs: str) -> str:
        return self.taken() if self.word in signs else ""

    def needs(self, sign: str) -> None:
        if not self.accepts(sign):
            raise self.unexpected()

    def sum(self) -> Polynomial:
        total = dict(self.product())
        while sign := self.accepts("+", "-"):
            self.add(total, self.product(), 1 if sign == "+" else -1)
        return total

    def product(self) -> Polynomial:
        total = self.unary()
        while sign := self.accepts("*", "/"):
            factor = self.unary()
            if sign == "/":
                factor = self.power(factor, Fraction(-1), "a division by")
            total = self.times(total, factor)
        return total

    def unary(self) -> Polynomial:
        minuses = 0
        while sign := self.accepts("+", "-"):
            minuses += sign == "-"
        _require_flat(minuses)
        found = self.raised()
        return {key: -c for key, c in found.items()} if minuses % 2 else found

    def raised(self) -> Polynomial:
        base = self.atom()
        if not self.accepts("^", "**"):
            return base
        exponent = self.inner(self.unary)
        if exponent.keys() - {NUMBER}:
            told = f"the exponent {_shown(exponent)}"
            raise ModelError(told, "a rational number", "write a number there")
        return self.power(base, exponent.get(NUMBER, Fraction(0)))

    def atom(self) -> Polynomial:
        if self.kind == "number":
            return _number(self.taken())
        if self.kind == "name":
            name = self.taken()
            if not name.endswith("'") and self.word == "(":
                return self.function(name)
            if name != "pi" and name not in self.names:
                cure = "declare it in the model file, or write the name that is"
                cure = f"write {name}(...)" if name in FUNCTIONS else cure
                raise _unknown(name, self.names, "a declared name: one of", cure)
            base = Expression("pi") if name == "pi" else symbol(name)
            return _alone(base)
        return self.within()

    def function(self, name: str) -> Polynomial:
        if name in self.names:
            told = f"{name[:60]!r} before a parenthesis"
            cure = f"write {name[:60]}*(...) for a product"
            raise ModelError(told, "a function or an operator there", cure)
        if name not in FUNCTIONS:
            cure = "write a product with *"
            raise _unknown(name, frozenset(FUNCTIONS), "a function: one of", cure)
        return self.call(name, self.within())

    def within(self) -> Polynomial:
        """Read a sum in parentheses."""
        self.needs("(")
        found = self.inner(self.sum)
        self.needs(")")
        return found

    def inner(self, part: Callable[[], Polynomial]) -> Polynomial:
        self.nesting += 1
        _require_flat(self.nesting)
        found = part()
        self.nesting -= 1
        return found

    def unexpected(self) -> ModelError:
        cure = "write a name or a number there, or take out what does not belong"
        if self.kind in ("name", "number") or self.word == "(":
            cure = "write an operator before it: * for a product"
        expected = "an equation: expression = expression" if self.equation else "an expression"
        return ModelError(
            f"{repr(self.word[:40]) if self.word else 'the end of the text'} in {self.text[:60]!r}",
            f"{expected} of names, numbers, + - * / ^ and ( )",
            cure,
            place=f"column {self.place - self.text.rfind(chr(10), 0, self.place)}",
        )


def _number(text: str) -> Polynomial:
    if not re.search("[1-9]", re.split("[eE]", text)[0]):
        return {}  # 0e999999999 is not to be computed
    if len(text) > 60 or not 1e-200 < float(text) < 1e200:
        raise ModelError(f"the number {text[:40]}", "1e-200 to 1e200", "scale the equation")
    return {NUMBER: Fraction(text)}


def _power_of_number(value: Fraction, exponent: Fraction) -> Polynomial:
    """Return a power of a number other than zero: a fraction times roots of primes."""
    if exponent.denominator == 1:
        _check_digits(value, int(exponent))
        return {NUMBER: value ** int(exponent)}
    total, roots = Fraction(1), {}
    for left, sign in ((value.numerator, 1), (value.denominator, -1)):
        found: dict[int, int] = Counter()  # small factors; what is left counts as a prime
        for factor in range(2, _PRIMES + 1):
            while left % factor == 0:
                left //= factor
                found[factor] += 1
        if left > 1:
            found[left] += 1
        for prime, count in found.items():
            power = sign * count * exponent
            _check_digits(Fraction(prime), int(power // 1))
            total *= Fraction(prime) ** int(power // 1)
            if power % 1:
                roots[number(prime)] = power % 1
    return {frozenset(roots.items()): total}


def _value_of(value: Expression) -> Real:
    """Return the value of an expression that holds no name, to a hundred digits."""
    found = values_at({}, [value])
    largest = 10 ** (50 if value.kind == "tan" else MAX_EXPONENT)  # tan(pi/2) is 1e100
    if found is None or abs(found[0]) > largest:
        told = f"{shown(value)}: no finite real number"
        raise ModelError(told, f"real numbers, to 1e{MAX_EXPONENT}", "check divisors and roots")
    return found[0]


def _require_at_most(size: int | Fraction, most: int, found: str, cure: str) -> None:
    if size > most:
        raise ModelError(found.format(size), f"{most} at most", cure)


def _require_few(terms: int) -> None:
    _require_at_most(terms, MAX_TERMS, "too many terms when expanded", "split it")


def _check_digits(value: Fraction, power: int = 1) -> None:
    """Refuse a number, or a power of one before it is computed, of too many digits."""
    bits = max(value.numerator.bit_length(), value.denominator.bit_length()) * abs(power)
    if bits > DIGITS * 10 // 3:
        told = f"a number of more than {DIGITS} digits"
        cure = "write it as a decimal of a dozen digits"
        raise ModelError(told, "numbers as they are measured", cure)


def _require_flat(levels: int) -> None:
    _require_at_most(levels, MAX_NESTING, f"nesting deeper than {MAX_NESTING} levels", "flatten it")


def _unknown(name: str, names: frozenset[str], expected: str, cure: str) -> ModelError:
    listed = sorted(names)
    shown = ", ".join(listed[:30]) + (", ..." if len(listed) > 30 else "")
    told = f"the unknown name {name[:60]!r}"
    return ModelError(told, f"{expected} {shown}", nearest(name, listed, cure))
