/** The keyboard, by the place of its keys; it acts while the image has the focus. */

import type { Desk } from "../desk";

export function listenToKeyboard(desk: Desk, image: HTMLElement): void {
  const paces = new Set<string>();
  const held = new Set<string>();

  image.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const binding = desk.keys.get(event.code);
    if (!binding || event.target !== image) return;
    event.preventDefault();
    if (event.repeat) return;
    if (binding.does === "knob") {
      held.add(event.code);
      desk.press(event.code, binding.knob.id, binding.sign);
    } else if (binding.does === "action") desk.run(binding.action);
    else {
      paces.add(event.code);
      desk.holdPace(binding.pace);
    }
  });

  // everywhere: help by its sign, and what stops
  document.addEventListener("keydown", (event) => {
    const inside = event.target as HTMLElement;
    if (event.defaultPrevented || inside.matches("input, textarea") || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === "?") desk.run("help");
    if (event.key === "Escape" && !inside.closest("dialog, [role=menu]")) desk.run("close");
  });

  // the image shows that it has the focus to those who came by the Tab key
  window.addEventListener("keydown", ({ key }) => document.body.classList.toggle("tabbing", key === "Tab"), true);
  window.addEventListener("pointerdown", () => document.body.classList.remove("tabbing"), true);

  window.addEventListener("keyup", (event) => {
    held.delete(event.code);
    desk.release(event.code);
    if (paces.delete(event.code) && paces.size === 0) desk.holdPace(null);
  });

  const stop = () => {
    held.clear();
    paces.clear();
    desk.stop();
  };
  window.addEventListener("blur", stop);
  // keys come up elsewhere; what a pointer holds or has set as a goal took the focus and goes on
  image.addEventListener("blur", () => {
    for (const code of held) desk.release(code);
    held.clear();
    paces.clear();
    desk.holdPace(null);
  });
  document.addEventListener("visibilitychange", stop);
}
