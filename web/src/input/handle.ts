/** The needle's handle under a pointer: along its axis pushes, sideways turns; wheel and double clicks beside it. */

import type { Desk } from "../desk";
import { ALONG, ANGLE, PUSH } from "../knobs";
import { PACE } from "../motion";
import type { ImagePane } from "../parts/imagePane";
import { draggable } from "./drag";

/** px of a drag before it is known to go along or sideways. */
const DECIDE = 5;
const DEGREES_PER_PX = 0.15;
/** px of a wheel notch. */
const NOTCH = 100;
const DOUBLE_TAP = 350;

export function handleInput(pane: ImagePane, desk: Desk): void {
  const { session } = desk;
  let lastUp = 0;

  draggable(pane.handle, () => {
    if (!session.answers) return null;
    const now = performance.now();
    if (now - lastUp < DOUBLE_TAP) {
      desk.run("skin");
      return null;
    }
    const map = pane.mapping;
    const axis = pane.needleOnScreen();
    if (!map || !axis) return null;
    const [depth, angle, entry] = [session.value(PUSH), session.value(ANGLE), session.value(ALONG)];
    let mode: "along" | "sideways" | null = null;
    pane.element.classList.add("dragging");
    // needle and handle follow the pointer, no faster than the picture
    return {
      move: (dx, dy) => {
        const along = dx * axis[0] + dy * axis[1];
        const sideways = map.sign * (-dx * axis[1] + dy * axis[0]);
        if (!mode && Math.hypot(dx, dy) > DECIDE) mode = Math.abs(along) >= Math.abs(sideways) ? "along" : "sideways";
        const pace = PACE[desk.motion.pace];
        if (desk.switches.placing) desk.goTo(ALONG, entry + (map.sign * dx) / map.scale, "fast");
        else if (mode === "along") {
          pane.grabbedAt = depth;
          desk.goTo(PUSH, depth + (along / map.scale) * pace, "fast");
        } else if (mode === "sideways") desk.goTo(ANGLE, angle - sideways * DEGREES_PER_PX * pace, "fast");
      },
      end: () => {
        for (const id of [PUSH, ANGLE, ALONG]) desk.halt(id);
        pane.grabbedAt = null;
        lastUp = mode === null ? performance.now() : 0;
        pane.element.classList.remove("dragging");
        pane.refresh();
      },
    };
  });

  pane.element.addEventListener(
    "wheel",
    (event) => {
      if (event.ctrlKey || !session.answers) return;
      event.preventDefault();
      const notches = (event.deltaMode === 0 ? event.deltaY : event.deltaY * 33) / NOTCH;
      desk.nudge(PUSH, notches * session.knob(PUSH).step * PACE[desk.motion.pace]);
    },
    { passive: false },
  );

  // a double click or double tap on the skin line: the needle goes in there next
  pane.element.addEventListener("dblclick", (event) => {
    const u = pane.skinAt(event.clientX, event.clientY);
    if (u === null || !session.answers || pane.handle.contains(event.target as Node)) return;
    if (!desk.switches.placing) desk.run("entry");
    desk.goTo(ALONG, u, "fast");
  });
}
