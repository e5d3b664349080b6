"""Push a needle that remembers 45 mm into gel, pull it back by 20 mm, and see what it drags along."""

import numpy as np

import sonospline as ss
from sonospline.mechanics import Material
from sonospline.models.elastic import ElasticModel

SIDE, SPEED = 100.0, 10.0  # mm, and mm/s
DEEPEST, PULLED, STEP = 45.0, 20.0, 0.5

tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=SIDE / 24))


def needle(depth):
    return {"needle": ss.Needle((0, 50, 50), (depth, 50, 50))}


model = ElasticModel(tissue, Material(10), contact="track")
depths = np.concatenate([np.arange(STEP, DEEPEST + 0.1, STEP), np.arange(DEEPEST, DEEPEST - PULLED - 0.1, -STEP)])
state, forces = model.rest, []
for depth in depths:
    response = model.step(state, needle(depth), dt=STEP / SPEED)
    state = response.state
    forces.append(response.forces["needle"].axial_n)

across = np.linspace(0, 100, 81)
plane = np.stack(np.meshgrid(across, across, [50.0], indexing="ij"), axis=-1).reshape(-1, 3)
pushed = ElasticModel(tissue, Material(10), contact="track")
last = pushed.step(pushed.rest, needle(DEEPEST - PULLED), dt=2.5)
way_in, way_out = (field.displacement(plane)[:, 0].reshape(81, 81) for field in (last.field, response.field))
middle = response.field.displacement([[12.5, 50, 50]])[0, 0]  # mid-shaft

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    print(f"force on the tissue {forces[len(depths) // 2]:.2f} N pushed, {forces[-1]:.2f} N pulled back")
    print(f"at mid-shaft the tissue stands {-middle:.2f} mm outward of rest")
    figure, (curve, *panes) = plt.subplots(1, 4, figsize=(15, 3.6), layout="constrained")
    curve.plot(depths, forces, lw=1.5)
    curve.axhline(0, color="0.7", lw=0.8)
    curve.set(xlabel="depth of the tip, mm", ylabel="force on the tissue, N", title="in, and back out")
    pictures = {"25 mm deep, pushed": way_in, "25 mm deep, pulled": way_out, "the difference": way_out - way_in}
    largest = max(np.abs(picture).max() for picture in pictures.values())
    for pane, (title, picture) in zip(panes, pictures.items(), strict=True):
        shown = pane.imshow(picture.T, cmap="RdBu_r", vmin=-largest, vmax=largest, extent=(0, 100, 100, 0))
        pane.plot([0, DEEPEST - PULLED], [50, 50], color="0.2", lw=1.5)
        pane.set(title=title, xlabel="along the needle, mm")
    figure.colorbar(shown, ax=panes, label="moved along the needle, mm", shrink=0.9)
    figure.savefig("push_and_pull.png", dpi=110)
