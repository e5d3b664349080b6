/** A menu below its button: by pointer and by keys, and where the focus goes when it closes. */

import { DONE } from "../input/focus";

export interface Popup { open: (byPointer: boolean) => void; close: (focus?: boolean) => void }

/** `entries` are made anew whenever the menu opens. */
export function popup(root: HTMLElement, button: HTMLElement, menu: HTMLElement, entries: () => HTMLElement[]): Popup {
  /** Whether a pointer opened the menu: then the image has the focus when it closes. */
  let pointed = false;
  const items = () => [...menu.querySelectorAll<HTMLElement>("[role^=menuitem]")];
  const close = (focus = true) => {
    if (menu.hidden) return;
    menu.hidden = true;
    button.setAttribute("aria-expanded", "false");
    if (focus && pointed) root.dispatchEvent(new Event(DONE, { bubbles: true }));
    else if (focus) button.focus();
  };
  const open = (byPointer: boolean) => {
    pointed = byPointer;
    menu.replaceChildren(...entries());
    menu.hidden = false;
    button.setAttribute("aria-expanded", "true");
    (items().find((item) => item.getAttribute("aria-checked") === "true") ?? items().at(0))?.focus();
  };
  button.addEventListener("click", ({ detail }) => (menu.hidden ? open(detail > 0) : close()));
  button.addEventListener("keydown", (event) => {
    if (event.code !== "ArrowDown") return;
    event.preventDefault();
    open(false);
  });
  menu.addEventListener("keydown", (event) => {
    const now = items().indexOf(document.activeElement as HTMLElement);
    const next = { ArrowDown: now + 1, ArrowUp: now - 1, Home: 0, End: -1 }[event.code];
    if (event.code === "Escape") close();
    if (event.code === "Tab") close(false);
    if (next === undefined) return;
    event.preventDefault();
    items().at(next % items().length)?.focus();
  });
  document.addEventListener("pointerdown", (event) => {
    if (!root.contains(event.target as Node)) close(false);
  });
  return { open, close };
}
