"""One sample: an insertion with the image of it, and what is true of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.needle import Needle, equal_steps
from ..models.contract import Response, TissueModel
from ..models.insertion import NEEDLE
from ..simulator.scene_model import tissue_model
from ..simulator.scene_view import View, view_of
from ..ultrasound.bmode import BMode
from ..ultrasound.synthesis import Scanner
from .anatomy import Anatomy
from .image_truth import displacement_now, labels_now, needle_pixels
from .recipe import Recipe
from .specification import Specification

HUNDREDTH_MM = 0.01
"""What displacements are kept to."""

_FARTHEST_MM = 300.0
_MARGINS_MM = (8.0, 16.0, 32.0, 64.0)
"""Displacements that scatterers are chosen for: a scanner for each, so that no sample changes what another sees."""
_MOST_STEPS = 12
"""Of a needle that rests, until the field is as near as the model's tolerance."""


class UnsettledError(RuntimeError):
    """The tissue did not come to rest."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A sample; :mod:`sonospline.dataset.layout` says what its arrays are."""

    recipe: Recipe
    arrays: Mapping[str, NDArray[Any]]
    row: Mapping[str, Any]
    """Its row of the table."""

    def __repr__(self) -> str:
        held = ", ".join(f"{name} {array.shape}" for name, array in self.arrays.items())
        return f"Sample({self.recipe.index}, {self.recipe.target}; {held or 'no arrays'})"


class World:
    """An anatomy with a model that answers and a scanner that looks: made once, used for all samples of it.

    Nothing of one sample is left for the next: each begins with tissue at rest, and its bits are those
    that it has alone.

    Parameters
    ----------
    anatomy : Anatomy
        What it is.
    labels : mapping of str to int
        Number of each tissue in label images.
    """

    def __init__(self, anatomy: Anatomy, labels: Mapping[str, int]) -> None:
        self.anatomy = anatomy
        self._labels = labels
        self._scanners: dict[tuple[tuple[float, ...], float], Scanner] = {}
        self._at_margin: dict[float, Scanner] = {}

    @cached_property
    def model(self) -> TissueModel:
        """What answers."""
        anatomy = self.anatomy
        spec = replace(anatomy.source.scene, model=anatomy.asked.model)
        return tissue_model(spec, anatomy.tissue, anatomy.tissues, anatomy.asked.model.use)

    @cached_property
    def _view(self) -> View:
        return view_of(self.anatomy.source.scene, self.anatomy.phantom)

    @cached_property
    def _numbers(self) -> NDArray[np.uint8]:
        numbers = np.zeros(256, np.uint8)
        for label, name in self.anatomy.source.names.items():
            numbers[label] = self._labels[name]
        return numbers

    def scanner(self, recipe: Recipe, largest_mm: float) -> Scanner:
        """Return the scanner at a recipe's pose, for tissue that moves so far."""
        margin = next(margin for margin in _MARGINS_MM if largest_mm <= margin or margin == _MARGINS_MM[-1])
        key = (recipe.probe, margin)
        if key not in self._scanners:
            base = self._first_scanner(recipe, margin)
            if any(probe != recipe.probe for probe, _ in self._scanners):
                self._scanners.clear()  # the probe has moved on
            self._scanners[key] = base
        return self._scanners[key]

    def _first_scanner(self, recipe: Recipe, margin: float) -> Scanner:
        pose = self.anatomy.source.frame.probe_to_reference(recipe.probe_command, self.anatomy.source.press_mm)
        alike = self._at_margin.get(margin)
        if alike is None:
            view, stored = self._view, self.anatomy.asked.stored
            alike = self._at_margin[margin] = Scanner(
                view.phantom, self.anatomy.probe, pose, seed=self.anatomy.seed, margin_mm=margin,
                needle_echo=view.echo, picture_shape=(stored.pixels, stored.pixels), artefacts=view.artefacts,
                display=view.display,
            )  # fmt: skip
        return alike.moved(pose)

    def sample(self, recipe: Recipe, split: str = "") -> Sample:
        """Make a sample.

        Raises
        ------
        ValueError, RuntimeError
            It cannot be: an entry in bone, tissue that does not come to rest.
        """
        response, events = _inserted(self.model, recipe, self.anatomy.asked)
        needle, field = dict(response.state.needles)[NEEDLE], GridField.of(response.field)
        largest = float(np.abs(field.values).max())
        if not largest <= _MARGINS_MM[-1]:
            raise UnsettledError(f"the tissue moves by {largest:g} mm, farther than {_MARGINS_MM[-1]:g}")
        view = self.scanner(recipe, largest)
        scanner = view.with_display(gain_db=view.display.gain_db + recipe.gain_db, noise_db=recipe.noise_db)
        bmode = scanner.render(field, needle, frame=recipe.index)
        shaft = self._shaft(needle, bmode)
        row = {
            "index": recipe.index, "split": split, "failed": None, "source": recipe.scene, "anatomy": recipe.anatomy,
            "view": recipe.view, "target": recipe.target, "target_mm": recipe.target_mm,
            **_places(scanner, needle, recipe, field), **_forces(response), "needle_px": int(shaft.sum()),
            "largest_mm": largest, "frequency_mhz": self.anatomy.probe.frequency_mhz,
            "image_depth_mm": self.anatomy.probe.depth_mm, "gain_db": recipe.gain_db, "noise_db": recipe.noise_db,
            "events": events, "recipe": recipe.as_json(),
        }  # fmt: skip
        return Sample(recipe, self._arrays(field, bmode, shaft), row)

    def _shaft(self, needle: Needle, bmode: BMode) -> NDArray[np.bool_]:
        """Pixels of the needle inside the fan."""
        return needle_pixels(needle, self._view.echo.diameter_mm, self.anatomy.probe, bmode.frame.plane) & _fan(bmode)

    def _arrays(self, field: GridField, bmode: BMode, shaft: NDArray[np.bool_]) -> dict[str, NDArray[Any]]:
        """What the specification keeps."""
        stored, plane, arrays = self.anatomy.asked.stored, bmode.frame.plane, dict[str, NDArray[Any]]()
        if stored.image:
            arrays["image"] = bmode.pixels
        if stored.labels or stored.displacement:
            moved = displacement_now(field, plane, stored.stride)
            if stored.labels:
                now = labels_now(self.anatomy.painted.acoustic, self._numbers, moved, plane)
                arrays["labels"] = np.where(_fan(bmode), now, np.uint8(0))
            if stored.displacement:
                arrays["displacement"] = _hundredths(moved)
        if stored.needle:
            arrays["needle"] = shaft.astype(np.uint8)
        if stored.volume:
            arrays["volume"] = _hundredths(_on_lattice(field, stored.volume))
        if stored.iq:
            iq = (bmode.iq / np.sqrt(bmode.optics.speckle_power).astype(np.float32)).view(np.float32)
            arrays["iq"] = iq.reshape(*bmode.iq.shape, 2).astype(np.float16)
        return arrays


def _inserted(model: TissueModel, recipe: Recipe, asked: Specification) -> tuple[Response, list[str]]:
    """The tissue's answer to the needle, from rest to the model's tolerance, and what happened on the way."""
    needle, state, said = recipe.needle, model.rest, []
    way: Sequence[tuple[Needle, float]] = ((needle, 0.0),)
    if asked.model.contact == "track":
        dt = needle.depth / asked.needle.steps / recipe.speed_mm_s
        way = [(part, dt) for part in equal_steps(needle, asked.needle.steps)]
    for part, dt in way:
        response = model.step(state, {NEEDLE: part}, dt)
        state = response.state
        said += [str(event) for event in response.events if str(event) not in said]
    tolerance = getattr(model, "tolerance", None)
    for _ in range(_MOST_STEPS):
        if tolerance is None or (response.error_estimate or 0.0) <= tolerance:
            return response, said
        response = model.step(response.state, dict(response.state.needles))
        said += [str(event) for event in response.events if str(event) not in said]
    raise UnsettledError(
        f"the tissue has not come to rest: error estimate {response.error_estimate:.1g} after {_MOST_STEPS} steps"
    )


def _hundredths(mm: NDArray[np.floating]) -> NDArray[np.int16]:
    """Displacement as whole hundredths of a mm; what is not known as the lowest number."""
    known = np.isfinite(mm)
    rounded = np.rint(np.clip(np.where(known, mm, 0.0), -_FARTHEST_MM, _FARTHEST_MM) / HUNDREDTH_MM)
    return np.where(known, rounded, -32768).astype(np.int16)


def _on_lattice(field: GridField, nodes: int) -> NDArray[np.floating]:
    """Displacement at so many nodes along each side of the box, in the world."""
    grid = field.grid
    parts = np.stack(np.meshgrid(*[np.linspace(0, 1, nodes)] * 3, indexing="ij"), axis=-1)
    places = grid.world((parts * grid.extent).reshape(-1, 3))
    return field.displacement(places).reshape(nodes, nodes, nodes, 3)


def _places(scanner: Scanner, needle: Needle, recipe: Recipe, field: GridField) -> dict[str, Any]:
    """Columns of the table: where needle, target and image are."""
    target, plane = np.array(recipe.target_mm), scanner.plane
    now = target + field.displacement(target)
    return {
        "target_now_mm": now.tolist(), "entry_mm": needle.entry.tolist(), "tip_mm": needle.tip.tolist(),
        "depth_mm": needle.depth, "tip_px": plane.pixels(needle.tip).tolist(), "target_px": plane.pixels(now).tolist(),
        "tip_off_plane_mm": float(plane.project(needle.tip[None])[0, 2]),
        "image_to_reference": plane.image_to_reference.ravel().tolist(), "pixel_mm": plane.spacing_mm[0],
    }  # fmt: skip


def _forces(response: Response) -> dict[str, Any]:
    """Columns of the table: the needle's force on the tissue, and the error of the field; None where not known."""
    # get() would ask a model that knows no forces for one
    force = response.forces[NEEDLE] if NEEDLE in response.forces else None  # noqa: SIM401
    return {
        "force_axial_n": None if force is None else force.axial_n,
        "force_n": None if force is None else force.force_n.tolist(),
        "error_estimate": response.error_estimate,
    }


def _fan(bmode: BMode) -> NDArray[np.bool_]:
    fan = bmode.frame.mask
    assert fan is not None  # synthetic images have one
    return fan
