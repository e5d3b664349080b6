/** The probe under a pointer in the 3-D view: dragging its body slides and sweeps it, dragging its head turns it. */

import * as THREE from "three";
import type { Desk } from "../desk";
import { PACE } from "../motion";
import type { View3d } from "./view";

const DEGREES_PER_PX = 0.5;
/** Below this height over the face (mm) the probe is gripped at its head, which turns it. */
const HEAD = 14;

export function dragProbe(view: View3d, desk: Desk): void {
  const { session } = desk;
  const caster = new THREE.Raycaster();

  const hit = (event: PointerEvent): THREE.Vector3 | null => {
    if (!view.probe?.visible) return null;
    const box = view.canvas.getBoundingClientRect();
    const at = new THREE.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
    caster.setFromCamera(at, view.camera);
    return caster.intersectObject(view.probe)[0]?.point ?? null;
  };

  // before the orbit controls see it: they would turn the view
  view.canvas.addEventListener(
    "pointerdown",
    (event) => {
      const point = event.button === 0 && session.answers ? hit(event) : null;
      if (!point || !session.scene || !view.probe) return;
      event.stopImmediatePropagation();
      view.canvas.setPointerCapture(event.pointerId);
      const height = -point.clone().applyMatrix4(view.probe.matrix.clone().invert()).y;
      const follow = height < HEAD ? turning(event) : moving(event, point);
      const end = () => {
        view.canvas.removeEventListener("pointermove", follow);
        for (const name of ["pointerup", "pointercancel"]) view.canvas.removeEventListener(name, end);
      };
      view.canvas.addEventListener("pointermove", follow);
      for (const name of ["pointerup", "pointercancel"]) view.canvas.addEventListener(name, end);
    },
    { capture: true },
  );

  const turning = (down: PointerEvent) => {
    const start = session.value("rotate");
    return (event: PointerEvent) => session.setAxis("rotate", start + (event.clientX - down.clientX) * DEGREES_PER_PX * PACE[desk.motion.pace]);
  };

  /** The pointer's way over the skin, as slide and sweep. */
  const moving = (down: PointerEvent, from: THREE.Vector3) => {
    const frame = session.scene?.frame;
    const [slide, sweep] = [session.value("slide"), session.value("sweep")];
    const [right, depth, out] = [frame?.right, frame?.depth, frame?.out].map((v) => new THREE.Vector3(...((v ?? [0, 0, 0]) as [number, number, number])));
    const skin = new THREE.Plane().setFromNormalAndCoplanarPoint(depth, from);
    const box = view.canvas.getBoundingClientRect();
    return (event: PointerEvent) => {
      const at = new THREE.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
      caster.setFromCamera(at, view.camera);
      const to = caster.ray.intersectPlane(skin, new THREE.Vector3());
      if (!to || down.pointerId !== event.pointerId) return;
      const way = to.sub(from).multiplyScalar(PACE[desk.motion.pace]);
      session.setAxis("slide", slide + way.dot(right));
      session.setAxis("sweep", sweep + way.dot(out));
    };
  };
}
