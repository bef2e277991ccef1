"""The model of a result, from the result alone."""

from __future__ import annotations

from pathlib import PurePath

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.models import Model, load_model, parse_model, shipped_models


def own_model(estimate: Estimate) -> Model:
    """Return the model that an estimate was made with, from the estimate alone.

    Parameters
    ----------
    estimate : Estimate
        It holds its model file's text; one of an older version, which does not, is taken to be of
        the shipped model of that name.

    Returns
    -------
    Model

    Raises
    ------
    InputError
        For an older estimate of a model that is not shipped.

    Examples
    --------
    >>> import rotorid as rid
    >>> mass = rid.Value("m", "kg", 2.0, std=0.01)
    >>> rid.own_model(rid.Estimate("jeffcott", "ml", "ok", (mass,))).coordinates
    ('x', 'y')
    """
    source = estimate.provenance
    if source is not None and source.model:
        model = parse_model(
            source.model, name=estimate.model, file=f"the result's {estimate.model}"
        )
        return model.substitute(dict(source.held))
    files = () if source is None else source.files
    own = any(PurePath(f.file).name == f"{estimate.model}.toml" for f in files[1:])
    if estimate.model in shipped_models() and not own:
        return load_model(estimate.model)
    raise InputError(
        f"a result of {estimate.model[:60]!r} without the text of its model",
        "a result that holds it, or one of a shipped model",
        "identify again with this version",
    )
