"""A needle in a phantom prostate, slow and fast.

Claims: a slow hand (2 mm/s) takes the middle of the gland along by 10 to 20 mm before the capsule breaks, a fast device
(1 m/s) by about 1 mm (at most 2). Published: up to 20 mm by hand, 1 mm with a pneumatic device (McLaughlin et al., AAPM
2022). The phantom's values are assumed (sonospline.study.prostate). What does it: without the rate of rupture, without
relaxation. Half a minute.
"""

from dataclasses import replace

from sonospline.mechanics import Membrane
from sonospline.models.elastic import ElasticModel
from sonospline.study import prostate

SPEEDS = (1, 2, 5, 20, 50, 200, 1000)

model = prostate.prostate_model()
passes = {speed: prostate.pushed_at(model, speed) for speed in SPEEDS}
print("speed, mm/s   gland moved, left, mm   force, N   capsule broke at a depth of")
for speed, one in passes.items():
    print(f"{speed:11g} {one.moved_mm:13.1f} {one.left_mm:6.1f} {one.force_n:11.2f} {one.punctured_mm:15.0f} mm")

tissues = model.tissues
rateless = replace(tissues, membranes=(Membrane("prostate capsule", ["prostate"], prostate.CAPSULE.rupture_force_n),))
variants = {
    "rupture at any speed alike": ElasticModel(
        model.tissue, rateless, nodes=prostate.NODES, contact="track", relaxation="tissue"
    ),
    "no relaxation": ElasticModel(model.tissue, tissues, nodes=prostate.NODES, contact="track"),
}
for name, variant in variants.items():
    slow, fast = (prostate.pushed_at(variant, speed).moved_mm for speed in (2, 1000))
    print(f"{name}: {slow:.1f} mm slow, {fast:.1f} mm fast")

missed = int(not 10 <= passes[2].moved_mm <= 20) + int(passes[1000].moved_mm > 2)
print(f"{missed} missed")
raise SystemExit(missed > 0)
