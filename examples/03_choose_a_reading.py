"""Two readings of Algorithm 1, and what the choice of kernel does between the landmarks."""

import numpy as np

import sonospline as ss

tissue = ss.Tissue(ss.Grid.unit_cube(25), entry_face="x-")
entry, target = (0, 0.4, 0.6), (0.6, 0.5, 0.5)

readings = {
    "largest displacement so far, from the reference": ss.Insertion(tissue),
    "the same with U = r^3": ss.Insertion(tissue, kernel=ss.Triharmonic()),
    "increments on the moving mesh": ss.Insertion(
        tissue, ss.NeedleTissueModel.paper_incremental(), accumulation="incremental"
    ),
}
fields = {name: list(insertion.run(entry, target, steps=20))[-1] for name, insertion in readings.items()}
mean_displacement = {
    name: float(np.linalg.norm(field.on_grid()[~tissue.pinned], axis=-1).mean()) for name, field in fields.items()
}

if __name__ == "__main__":
    for name, mean in mean_displacement.items():
        print(f"{name:50s} mean |u| = {mean:.5f} cube sides")
