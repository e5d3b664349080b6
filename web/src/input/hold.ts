/** A button that makes one step when tapped and moves steadily while held. */

import type { Desk } from "../desk";

let count = 0;

export function holdable(button: HTMLElement, desk: Desk, id: string, sign: 1 | -1): void {
  const source = `button${(count += 1)}`;
  let handled = false;
  const press = () => {
    handled = true;
    button.classList.add("pressed");
    desk.press(source, id, sign);
  };
  const release = () => {
    button.classList.remove("pressed");
    desk.release(source);
  };
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    press();
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(name, release);
  button.addEventListener("keydown", (event) => {
    if ((event.code !== "Space" && event.code !== "Enter") || event.repeat) return;
    press();
  });
  button.addEventListener("keyup", (event) => {
    if (event.code === "Space" || event.code === "Enter") release();
  });
  // a click without a pointer or key comes from assistive technology: one step
  button.addEventListener("click", () => {
    if (!handled) {
      desk.press(source, id, sign);
      desk.release(source);
    }
    handled = false;
  });
  // the image keeps the focus, so that the other hand's keys act meanwhile
  button.addEventListener("mousedown", (event) => event.preventDefault());
  button.addEventListener("contextmenu", (event) => event.preventDefault());
}
