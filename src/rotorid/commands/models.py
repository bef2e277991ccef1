"""``rotorid models``."""

from __future__ import annotations

from rotorid.commands import OK
from rotorid.commands.console import show
from rotorid.models import load_model, shipped_models
from rotorid.report.record_tables import model_list, model_page


def run(name: str | None) -> int:
    if name is None:
        show([model_list(load_model(shipped) for shipped in shipped_models())])
        return OK
    model = load_model(name)
    if hasattr(model, "rotor"):
        from rotorid.models.rotor.rotor_model import RotorModel  # scipy: where a rotor is drawn
        from rotorid.report.record_tables import rotor_page

        assert isinstance(model, RotorModel)
        show(rotor_page(model))
    else:
        show(model_page(model))
    return OK
