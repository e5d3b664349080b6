"""Push a needle into the paper's unit cube and ask the field four questions."""

import numpy as np

import sonospline as ss

tissue = ss.Tissue(ss.Grid.unit_cube(25), entry_face="x-")
insertion = ss.Insertion(tissue, model=ss.NeedleTissueModel.paper())

*_, field = insertion.run(entry=(0, 0.5, 0.5), target=(0.6, 0.5, 0.5), steps=20)

point = (0.45, 0.55, 0.5)
deformed = field.forward(point)
largest = np.linalg.norm(field.on_grid(), axis=-1).max()

if __name__ == "__main__":
    print(f"a point at {point} moved to {deformed.round(4)}, and back to {field.inverse(deformed).round(4)}")
    print(f"largest displacement of any node: {largest:.4f} cube sides")
    print(f"smallest det J: {field.smallest_jacobian():.3f} (above zero: the tissue does not fold)")
    carriers = f"{insertion.landmark_count} landmarks and {len(insertion.anchors)} anchors"
    print(f"{carriers} carry {tissue.grid.node_count:,} nodes")
    field.plot(through=insertion.needle).figure.savefig("needle.png")
