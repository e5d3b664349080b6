"""Needles into the kidney of a scene, drawn at random: whether their forces are those of fresh human cadavers.

Published (J Endourol 2016, 10.1089/end.2016.0342): the skin is punctured at 2.75 to 2.80 N, which are averages, and
the overall slope of force against displacement is 0.35 to 0.59 N/cm. What the slope is taken over the abstract does
not say: here it is read both ways, over all of a curve and from the skin's puncture on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from ..contact.calibration.closed_form import Layer, force_along, tip_along
from ..contact.events import Punctured
from ..geometry.needle import Needle
from ..mechanics.material import Material
from ..mechanics.membranes import Membrane
from ..mechanics.tissue_map import TissueMap
from ..models.insertion import NEEDLE
from ..simulator.scene import Scene
from ..simulator.scene_model import scene_model

Array = NDArray[np.float64]

PEAK_N, SLOPE_N_CM = (2.75, 2.80), (0.35, 0.59)
"""Of human cadavers."""
SKIN, WALL, URINE = "skin", "calyx wall", "urine"
"""What is punctured first, and last, and where a pass ends."""
STEP_MM, SPEED_MM_S = 1.0, 5.0
"""Of a live pass: of the needle from step to step, and of the hand."""
ANGLE_DEG = (42.0, 72.0)
"""Of the needle to the skin; makes ways of 75 to 107 mm, where 65 to 129 are published (R J Urol 2016;195:377)."""
ASIDE_MM, BESIDE_MM = 4.0, 1.5
"""Standard deviations of the entry across the image and of what is aimed at; assumed."""
SPREAD = {"friction": 0.2, "cutting": 0.2, "rupture": 0.2, "stiffness": 0.3}
"""Standard deviations of the logarithms of a tissue's values, drawn for each tissue on its own; assumed."""
TENTING_N_MM = {"skin": 0.18, "inside": 0.2}
"""Force that takes the tissue ahead of a tip along by 1 mm; fitted to passes in the scene's elastic tissue."""
_IN_MM = 1e-6
_APART_MM = 0.25
"""Between the places at which the way is asked what it is made of, and between depths of a curve."""


@dataclass(frozen=True)
class Draw:
    """One pass: its way, and factors on the values of each tissue and membrane."""

    needle: Needle
    """From the skin to the target."""
    factors: Mapping[str, Mapping[str, float]]
    """By value ("friction", "cutting", "stiffness" of tissues; "rupture" of membranes) and name."""

    def material(self, name: str, material: Material) -> Material:
        """Return a tissue with the values of this draw; what only tracks know is changed, and stiffness."""
        return replace(
            material,
            stiffness_kpa=material.stiffness_kpa * self.factors["stiffness"][name],
            track_friction_n_per_mm=material.sliding_friction_n_per_mm * self.factors["friction"][name],
            cutting_force_n=material.cutting_force_n * self.factors["cutting"][name],
        )

    def membrane(self, membrane: Membrane) -> Membrane:
        """Return a membrane that breaks at this draw's force."""
        return Membrane(
            membrane.name, membrane.around, membrane.rupture_force_n * self.factors["rupture"][membrane.name]
        )

    def of(self, tissues: TissueMap) -> TissueMap:
        """Return tissues with the values of this draw."""
        materials = {n: self.material(tissues.names[n], material) for n, material in tissues.materials.items()}
        return replace(tissues, materials=materials, membranes=tuple(map(self.membrane, tissues.membranes)))


class Reading(NamedTuple):
    """What is read off a curve of force against depth."""

    peak_n: float
    """At which the skin gave way."""
    slope_n_cm: float
    """From then on."""
    overall_n_cm: float
    """Of the whole curve."""

    @property
    def inside(self) -> tuple[bool, bool]:
        """Whether peak and slope are those of human cadavers: the slope from the puncture on, and overall."""
        punctured = _within(self.peak_n, PEAK_N)
        return punctured and _within(self.slope_n_cm, SLOPE_N_CM), punctured and _within(self.overall_n_cm, SLOPE_N_CM)

    @classmethod
    def of(cls, depths_mm: Array, force_n: Array, skin: tuple[float, float]) -> Reading:
        """Return the reading of a curve that ends at the calyx; its skin gave way at a depth and a force."""
        after = depths_mm >= skin[0]
        return cls(skin[1], _slope(depths_mm[after], force_n[after]), _slope(depths_mm, force_n))


def draw_passes(tissues: TissueMap, target: Array, count: int, seed: int, spread: Mapping[str, float]) -> list[Draw]:
    """Return passes from the skin, the face z = 0, to a target."""
    rng = np.random.default_rng(seed)
    names = sorted(set(tissues.names.values()))
    skin = next(m for m in tissues.membranes if m.name == SKIN)
    drawn = []
    for _ in range(count):
        angle = np.radians(rng.uniform(*ANGLE_DEG))
        aim = target + BESIDE_MM * rng.standard_normal(3)
        entry = np.array([aim[0] + aim[2] / np.tan(angle), target[1] + ASIDE_MM * rng.standard_normal(), 0.0])
        factors = {
            value: dict(zip(names, np.exp(sd * rng.standard_normal(len(names))).tolist(), strict=True))
            for value, sd in spread.items()
            if value != "rupture"
        }
        rupture = {m.name: float(np.exp(spread["rupture"] * rng.standard_normal())) for m in tissues.membranes}
        rupture[SKIN] = rng.uniform(*PEAK_N) / skin.rupture_force_n  # its published spread, of averages
        drawn.append(Draw(Needle(entry, aim), {**factors, "rupture": rupture}))
    return drawn


def layers_along(tissues: TissueMap, draw: Draw) -> list[Layer]:
    """Return what the needle of a draw meets on its way, with the draw's values."""
    places = np.arange(0.0, draw.needle.depth, _APART_MM)
    labels = tissues.labels_at(draw.needle.at(np.maximum(places, _IN_MM) / draw.needle.depth))
    begins = np.flatnonzero(np.append(True, labels[1:] != labels[:-1]))
    names = [tissues.names[int(labels[number])] for number in begins]
    stiffer = float(np.exp(np.mean([np.log(draw.factors["stiffness"][name]) for name in names])))
    layers: list[Layer] = []
    within = {m.name: False for m in tissues.membranes}
    for number, name in zip(begins, names, strict=True):
        material, met = draw.material(name, tissues.materials[int(labels[number])]), 0.0
        for membrane in tissues.membranes:
            if membrane.holds(name) != within[membrane.name]:
                within[membrane.name] = not within[membrane.name]
                met = max(met, draw.membrane(membrane).rupture_force_n)
        resists = not material.fluid
        tenting = stiffer * TENTING_N_MM["inside" if layers else "skin"]
        layers.append(
            Layer(
                name, float(places[number]), resists * material.sliding_friction_n_per_mm,
                resists * material.cutting_force_n, met, tenting,
            )
        )  # fmt: skip
    return layers


def predicted(tissues: TissueMap, draw: Draw) -> Reading:
    """Return the reading of a draw in closed form."""
    layers = layers_along(tissues, draw)
    depths = np.arange(_APART_MM, draw.needle.depth, _APART_MM)
    cut = tip_along(depths, layers).cut_mm
    within = cut < next((layer.begin_mm for layer in layers if layer.tissue == URINE), np.inf)
    opened = float(depths[np.argmax(cut > 0)])
    force = force_along(depths[within], layers)
    return Reading.of(depths[within], force, (opened, layers[0].rupture_force_n))


def pushed(scene: Scene, draw: Draw) -> Reading:
    """Return the reading of a draw in the scene's live tissue, pushed on until the tip is in the calyx."""
    spec = structs.replace(scene.spec, model=structs.replace(scene.spec.model, contact="track"))
    assert scene.tissues is not None
    model = scene_model(replace(scene, spec=spec, tissues=draw.of(scene.tissues)), "elastic")
    depths, needle = np.arange(STEP_MM, draw.needle.depth, STEP_MM), draw.needle
    state, forces, skin = model.rest, [], (np.inf, np.nan)
    for depth in depths:
        response = model.step(
            state, {NEEDLE: Needle(needle.entry, needle.at(depth / needle.depth))}, STEP_MM / SPEED_MM_S
        )
        state = response.state
        met = {event.membrane: event.force_n for event in response.events if isinstance(event, Punctured)}
        skin = (float(depth), met[SKIN]) if SKIN in met else skin
        if WALL in met:
            break
        forces.append(response.forces[NEEDLE].axial_n)
    return Reading.of(depths[: len(forces)], np.array(forces), skin)


def _slope(depths_mm: Array, force_n: Array) -> float:
    """Of the straight line through a curve, N/cm."""
    return 10 * float(np.polyfit(depths_mm, force_n, 1)[0])


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
