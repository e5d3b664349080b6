/** The probe under a pointer in the 3-D view: dragging it slides and sweeps, dragging its ring rotates. */

import * as THREE from "three";
import type { Desk } from "../desk";
import { ROTATE, SLIDE, SWEEP } from "../knobs";
import { PACE } from "../motion";
import { lightRing, RING_NAME } from "./transducer";
import type { View3d } from "./view";

/** Where the ring runs towards the viewer it hardly moves on the screen: no px may turn by more degrees. */
const MOST_DEGREES = 2;

interface Grip { at: THREE.Vector3; ring: boolean }
type Follow = (event: PointerEvent) => void;

export function dragProbe(view: View3d, desk: Desk): void {
  const { session } = desk;
  const { canvas } = view;
  const caster = new THREE.Raycaster();
  let held = false;

  const aim = (event: PointerEvent): void => {
    const box = canvas.getBoundingClientRect();
    const at = new THREE.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
    caster.setFromCamera(at, view.camera);
  };
  const grip = (event: PointerEvent): Grip | null => {
    if (!view.probe?.visible || !session.answers) return null;
    aim(event);
    const hit = caster.intersectObject(view.probe)[0];
    return hit ? { at: hit.point, ring: hit.object.parent?.name === RING_NAME } : null;
  };
  const light = (found: Grip | null): void => {
    canvas.style.cursor = found ? (found.ring ? "ew-resize" : held ? "grabbing" : "grab") : "";
    if (view.probe && lightRing(view.probe, found?.ring ?? false)) view.redraw();
  };

  // before the orbit controls see it: they would turn the view
  canvas.addEventListener(
    "pointerdown",
    (event) => {
      const found = event.button === 0 ? grip(event) : null;
      if (!found) return;
      event.stopImmediatePropagation();
      canvas.setPointerCapture(event.pointerId);
      held = true;
      light(found);
      const way = found.ring ? turning(event, found.at) : moving(found.at);
      const follow: Follow = (moved) => moved.pointerId === event.pointerId && way(moved);
      const end: Follow = (up) => {
        if (up.pointerId !== event.pointerId) return;
        held = false;
        light(null);
        canvas.removeEventListener("pointermove", follow);
        for (const name of ENDS) canvas.removeEventListener(name, end);
      };
      canvas.addEventListener("pointermove", follow);
      for (const name of ENDS) canvas.addEventListener(name, end);
    },
    { capture: true },
  );
  canvas.addEventListener("pointermove", (event) => {
    if (!held && event.pointerType === "mouse" && event.buttons === 0) light(grip(event));
  });

  /** The ring's point under the pointer goes with it. */
  const turning = (down: PointerEvent, from: THREE.Vector3): Follow => {
    const start = session.value(ROTATE);
    const pose = view.probe?.matrix ?? new THREE.Matrix4();
    const axis = new THREE.Vector3().setFromMatrixColumn(pose, 1);
    const arm = from.clone().sub(new THREE.Vector3().setFromMatrixPosition(pose));
    const degree = axis.cross(arm).multiplyScalar(Math.PI / 180);
    const [here, there] = [onScreen(from), onScreen(from.clone().add(degree))];
    const way = there.sub(here);
    const pace = Math.min(MOST_DEGREES, 1 / Math.max(way.length(), 1e-6)) * PACE[desk.motion.pace];
    way.normalize();
    return (event) => {
      const px = (event.clientX - down.clientX) * way.x + (event.clientY - down.clientY) * way.y;
      desk.goTo(ROTATE, start + px * pace, "fast");
    };
  };

  const onScreen = (point: THREE.Vector3): THREE.Vector2 => {
    const { x, y } = point.clone().project(view.camera);
    return new THREE.Vector2((canvas.clientWidth * x) / 2, (-canvas.clientHeight * y) / 2);
  };

  /** The pointer's way over the skin, as slide and sweep. */
  const moving = (from: THREE.Vector3): Follow => {
    const frame = session.scene?.frame;
    const [slide, sweep] = [session.value(SLIDE), session.value(SWEEP)];
    const [right, depth, out] = [frame?.right, frame?.depth, frame?.out].map((v) => new THREE.Vector3(...((v ?? [0, 0, 0]) as [number, number, number])));
    const skin = new THREE.Plane().setFromNormalAndCoplanarPoint(depth, from);
    return (event) => {
      aim(event);
      const to = caster.ray.intersectPlane(skin, new THREE.Vector3());
      if (!to) return;
      const way = to.sub(from).multiplyScalar(PACE[desk.motion.pace]);
      desk.goTo(SLIDE, slide + way.dot(right), "fast");
      desk.goTo(SWEEP, sweep + way.dot(out), "fast");
    };
  };
}

const ENDS = ["pointerup", "pointercancel"] as const;
