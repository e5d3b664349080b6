"""See what an ultrasound probe would show of a needle on its way into a calyx of the kidney."""

import numpy as np

import sonospline as ss
from sonospline.ultrasound import Probe, Scanner, kidney_phantom

kidney = kidney_phantom(spacing_mm=1.0)
scanner = Scanner(kidney.phantom, Probe.curvilinear(lines=128), kidney.probe_to_reference)
insertion = ss.Insertion(ss.Tissue(kidney.grid(nodes=30_000), entry_face="z-"))
field = insertion.advance(kidney.needle)

before = scanner.render()
after = scanner.render(field, kidney.needle)
calyx_shift = float(np.linalg.norm(field.displacement(kidney.needle.tip[None])))

if __name__ == "__main__":
    before.frame.save("before.png")
    after.frame.save("after.png")
    changed = np.mean(before.frame.pixels != after.frame.pixels)
    print(f"the calyx moved {calyx_shift:.2f} mm; {100 * changed:.0f} % of the picture changed: before.png, after.png")
