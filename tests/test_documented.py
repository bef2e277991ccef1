"""What `rotorid` exports is documented: each name, and each method that a user may call."""

import inspect

import pytest

import rotorid

CLASSES = [name for name in rotorid.__all__ if inspect.isclass(getattr(rotorid, name))]


@pytest.mark.parametrize("name", rotorid.__all__)
def test_each_exported_name_has_a_docstring(name):
    value = getattr(rotorid, name)
    if inspect.isclass(value) or callable(value) or inspect.ismodule(value):
        own = vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__
        assert own, name
        assert not own.startswith(f"{name}("), f"{name}: only the signature of a dataclass"


@pytest.mark.parametrize("name", CLASSES)
def test_each_method_of_an_exported_class_has_a_docstring(name):
    for method, value in vars(getattr(rotorid, name)).items():
        if method.startswith("_"):
            continue
        value = getattr(value, "func", getattr(value, "__func__", value))  # cached, of the class
        if inspect.isfunction(value) or isinstance(value, property):
            assert inspect.getdoc(value), f"{name}.{method}"
