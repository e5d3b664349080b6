/** What a button does and its key: on hover, on focus, on a long press. */

import { h } from "../dom";

const HOVER = 350;
const LONG_PRESS = 500;

export function hints(): HTMLElement {
  const text = h("span", {});
  const key = h("kbd", {});
  const tip = h("div", { class: "hint-tip", role: "tooltip", hidden: true }, text, key);
  let timer = 0;
  let shown: Element | null = null;

  const hide = () => {
    window.clearTimeout(timer);
    tip.hidden = true;
    shown = null;
  };
  const show = (element: HTMLElement) => {
    shown = element;
    text.textContent = element.dataset.hint ?? "";
    key.textContent = element.dataset.key ?? "";
    key.hidden = !element.dataset.key;
    tip.hidden = false;
    const box = element.getBoundingClientRect();
    const { width, height } = tip.getBoundingClientRect();
    const left = Math.min(window.innerWidth - width - 6, Math.max(6, box.left + (box.width - width) / 2));
    const above = box.top - height - 6;
    tip.style.left = `${left}px`;
    tip.style.top = `${above > 4 ? above : box.bottom + 6}px`;
  };
  const later = (element: HTMLElement | null, delay: number) => {
    if (element === shown && element) return;
    hide();
    if (element) timer = window.setTimeout(() => show(element), delay);
  };
  const hinted = (event: Event) => (event.target as Element).closest<HTMLElement>("[data-hint]");

  document.addEventListener("pointerover", (event) => {
    if (event.pointerType === "mouse") later(hinted(event), HOVER);
  });
  document.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse") hide();
    else later(hinted(event), LONG_PRESS);
  });
  document.addEventListener("pointerup", (event) => {
    if (event.pointerType !== "mouse") hide();
  });
  document.addEventListener("focusin", (event) => {
    const element = hinted(event);
    if (element?.matches(":focus-visible")) show(element);
    else hide();
  });
  window.addEventListener("blur", hide);
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") hide();
  });
  return tip;
}
