"""See what an ultrasound probe would show of a needle on its way into a calyx of the kidney."""

import numpy as np

import sonospline as ss

kidney = ss.kidney_phantom(spacing_mm=1.0)
scanner = ss.Scanner(kidney.phantom, ss.Probe.curvilinear(lines=128), kidney.probe_to_reference)
insertion = ss.Insertion(ss.Tissue(kidney.grid(nodes=30_000), entry_face="z-"))
field = insertion.advance(kidney.needle)

before = scanner.render()
after = scanner.render(field, kidney.needle)
calyx_shift = float(np.linalg.norm(field.displacement(kidney.needle.tip)))

if __name__ == "__main__":
    before.save("before.png")
    after.save("after.png")
    changed = np.mean(before.pixels != after.pixels)
    print(f"the calyx moved {calyx_shift:.2f} mm; {100 * changed:.0f} % of the picture changed: before.png, after.png")
