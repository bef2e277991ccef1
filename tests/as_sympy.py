"""Signals as sympy has them, to compare with."""

import sympy as sp


def symbol(name):
    return sp.Symbol(name, real=True)


def to_sympy(value):
    if value.kind == "name":
        return symbol(value.parts[0])
    if value.kind == "pi":
        return sp.pi
    if value.kind == "sum":
        return sp.Add(*(sp.Mul(_rational(c), *map(_power, factors)) for factors, c in value.parts))
    function = {"abs": "Abs"}.get(value.kind, value.kind)
    return getattr(sp, function)(to_sympy(value.parts[0]))


def _power(factor):
    return to_sympy(factor[0]) ** _rational(factor[1])


def _rational(number):
    return sp.Rational(number.numerator, number.denominator)
