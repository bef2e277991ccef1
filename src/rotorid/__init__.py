"""Physical parameters of magnetically levitated rotors, each with an error bar that holds."""

from typing import Any

import lazy_loader

# The one place that decides what is loaded when: the public names stand in `__init__.pyi`, and
# each is imported when it is first asked for.
_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("rotorid")
    return _load(name)
