"""Physical parameters of magnetically levitated rotors, each with an error bar that holds."""

from importlib.metadata import version as _version

__version__ = _version("rotorid")
