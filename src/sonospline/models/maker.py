"""Making a model of the registry for a tissue."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from .. import _validate
from .._shown import shown
from ..geometry.tissue import Tissue
from ..mechanics.material import Material
from ..mechanics.tissue_map import TissueMap
from . import registry
from .capability import CAPABILITIES
from .contract import TissueModel

DEFAULT_KPA = 10.0
"""Young's modulus of tissue of which nothing is said: soft tissue."""


def make(
    name: str,
    tissue: Tissue,
    materials: Material | TissueMap | None = None,
    *,
    needs: Iterable[str] = (),
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> TissueModel:
    """Return a model of the table, made for a tissue.

    Parameters
    ----------
    name : str
        One of :func:`~sonospline.models.names`.
    tissue : Tissue
        The box, its display grid and its free face.
    materials : Material or TissueMap, optional
        What it is made of, in kPa. By default soft tissue everywhere: 10 kPa, a Poisson's ratio of 0.45.
    needs : iterable of str
        What it must be able to do, of :data:`~sonospline.models.CAPABILITIES`.
    progress : callable, optional
        Called as ``progress(done, of)`` while a model that takes seconds is made.
    **options
        Those of :func:`~sonospline.models.spec`.

    Raises
    ------
    ValueError
        An unknown name or option, or a value out of range.
    CapabilityError
        The model cannot do what it needs, or knows no labels and is given some.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline import models
    >>> models.make("kelvinlet", ss.Tissue(ss.Grid.unit_cube(25)), drag_mm=0.02).name
    'kelvinlet'
    >>> models.make("paper", ss.Tissue(ss.Grid.unit_cube(25)), needs=["labels"])
    Traceback (most recent call last):
    sonospline.models.capability.CapabilityError: model = 'paper' cannot do labels; use model = 'elastic'
    """
    found = registry.spec(name)
    for capability in needs:
        registry.require(name, _validate.choice("needs", capability, CAPABILITIES))
    if isinstance(materials, TissueMap):
        registry.require(name, "labels")
    elif not isinstance(materials, Material | None):
        raise ValueError(f"materials = {shown(materials)} is none; give a Material, or a TissueMap for labelled tissue")
    values = found.check(options)
    if found.reports_progress:
        values["progress"] = progress
    model = found.maker(tissue, Material(DEFAULT_KPA) if materials is None else materials, **values)
    if not isinstance(model, TissueModel):
        raise ValueError(f"model = {name!r} makes {shown(model)}, which is not a TissueModel; ask whoever offers it")
    if isinstance(materials, TissueMap):
        model.tissues = materials
    return model
