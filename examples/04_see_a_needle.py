"""See what an ultrasound probe would show of a needle on its way into a calyx of the kidney."""

import numpy as np

import sonospline as ss
from sonospline.ultrasound import Probe, Ultrasound, kidney_phantom

phantom = kidney_phantom(spacing_mm=1.0)
scanner = Ultrasound(phantom.scene, Probe.curvilinear(lines=128), phantom.probe_pose)
insertion = ss.Insertion(ss.Tissue(phantom.grid(nodes=30_000), entry_face="z-"))
field = insertion.advance(phantom.needle)

before = scanner.render()
after = scanner.render(field, phantom.needle)
calyx_shift = float(np.linalg.norm(field.displacement(phantom.needle.tip[None])))

if __name__ == "__main__":
    before.frame.write("before.png")
    after.frame.write("after.png")
    changed = np.mean(before.frame.pixels != after.frame.pixels)
    print(f"the calyx moved {calyx_shift:.2f} mm; {100 * changed:.0f} % of the picture changed: before.png, after.png")
