"""Estimators, one per file; each is a value with one method, `estimate(model, records)`."""

import lazy_loader

# As in `rotorid`: each name is imported from where `__init__.pyi` says when it is asked for.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
