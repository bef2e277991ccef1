"""The decorator of values: what `dataclass(frozen=True)` gives, with methods that are shared."""

import ast
import copy
import pickle
from dataclasses import FrozenInstanceError, dataclass, field, fields, replace
from pathlib import Path

import pytest

import rotorid
from rotorid.core.frozen import frozen


@frozen
class Mass:
    """A value."""

    name: str
    value: float = 1.0
    note: str = field(default="", compare=False)
    table: tuple[float, ...] = field(default=(), repr=False)


@frozen
class Heavier(Mass):
    """A value with one field more."""

    more: int = 0


@dataclass(frozen=True)
class Plain:
    """The same by the standard library."""

    name: str
    value: float = 1.0
    note: str = field(default="", compare=False)
    table: tuple[float, ...] = field(default=(), repr=False)


@frozen
class Empty:
    """A value without fields."""


@frozen(kw_only=True)
class Told:
    """A value that says itself how it looks and what it equals."""

    one: int

    def __repr__(self) -> str:
        return "one"

    def __eq__(self, other):
        return True


PAIRS = [
    (("m",), ("m",)),
    (("m", 1.0, "a"), ("m", 1.0, "b")),
    (("m", 2.0), ("m", 1.0)),
    (("m", 1.0, "", (1.0,)), ("m", 1.0, "", (2.0,))),
]


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_equality_text_and_hash_are_those_of_a_dataclass(first, second):
    ours, theirs = (Mass(*first), Mass(*second)), (Plain(*first), Plain(*second))
    assert (ours[0] == ours[1]) == (theirs[0] == theirs[1])
    assert (hash(ours[0]) == hash(ours[1])) == (hash(theirs[0]) == hash(theirs[1]))
    assert repr(ours[0]) == repr(theirs[0]).replace("Plain", "Mass")


def test_one_class_is_not_another():
    assert Mass("m") != Heavier("m")
    assert Mass("m") != Plain("m")
    assert Heavier("m", more=1) != 1
    assert Heavier("m", more=1) != Heavier("m", more=2)
    assert Empty() == Empty()
    assert hash(Empty()) == hash(Empty())
    assert repr(Empty()) == "Empty()"
    assert len({Mass("m"), Mass("m", note="again"), Heavier("m")}) == 2


def test_what_a_class_says_itself_stands():
    assert repr(Told(one=1)) == "one"
    assert Told(one=1) == 2
    with pytest.raises(TypeError, match="positional"):
        Told(1)


def test_nothing_is_set_afterwards():
    mass = Mass("m")
    with pytest.raises(FrozenInstanceError, match="value"):
        mass.value = 2.0
    with pytest.raises(FrozenInstanceError, match="value"):
        del mass.value
    with pytest.raises(FrozenInstanceError, match="another"):
        mass.another = 2.0
    assert replace(mass, value=2.0) == Mass("m", 2.0)
    assert [each.name for each in fields(Heavier)] == ["name", "value", "note", "table", "more"]


def test_copies_are_equal():
    mass = Heavier("m", 2.0, more=3)
    assert copy.deepcopy(mass) == mass == pickle.loads(pickle.dumps(mass))


FULL = "dataclass(frozen=True)"


def test_every_value_of_the_package_is_made_by_it():
    """But for those whose `==` is identity, which nothing shared could say better."""
    own = []
    for path in sorted(Path(rotorid.__file__).parent.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        classes = (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
        decorators = ((kind, ast.unparse(d)) for kind in classes for d in kind.decorator_list)
        own += [
            (path.name, kind.name) for kind, text in decorators if text == "dataclass(frozen=True)"
        ]
    assert not own, "take rotorid.core.values"


def test_the_methods_are_shared():
    """The reason why it stands: a `dataclass` writes and compiles its own for each class."""
    for name in ("__eq__", "__hash__", "__repr__", "__setattr__", "__delattr__"):
        assert getattr(Mass, name) is getattr(Empty, name)
        assert getattr(Plain, name) is not getattr(Empty, name)
