"""Signals as sympy has them, to compare with."""

import sympy as sp


def symbol(name):
    return sp.Symbol(name, real=True)


def to_sympy(value):
    if value.kind == "name":
        return symbol(value.parts[0])
    if value.kind == "pi":
        return sp.pi
    if value.kind == "number":
        return sp.Rational(value.parts[0].numerator, value.parts[0].denominator)
    if value.kind in ("product", "power"):
        powers = ((to_sympy(base), n) for base, n in value.factors)
        return sp.Mul(*(base ** sp.Rational(n.numerator, n.denominator) for base, n in powers))
    inner = [to_sympy(part) for part in value.parts]
    function = {"sum": "Add", "abs": "Abs"}.get(value.kind, value.kind)
    return getattr(sp, function)(*inner)
