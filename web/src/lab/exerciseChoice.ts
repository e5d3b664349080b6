/** Which exercise is to be done, at one station or at all of them. */

import { h } from "../dom";
import type { Lab } from "./lab";

export function exerciseChoice(lab: Lab, label: string, station: () => string | null, set: () => string | null): HTMLElement {
  const select = h("select", { "aria-label": label });
  select.addEventListener("change", () => lab.say({ type: "set_exercise", station: station(), exercise: select.value || null }));
  lab.greeted.on(({ exercises }) => {
    select.replaceChildren(h("option", { value: "" }, "Free choice"), ...exercises.map(({ id, name }) => h("option", { value: id }, name)));
    select.value = set() ?? "";
  });
  const refresh = () => {
    if (document.activeElement !== select) select.value = set() ?? "";
  };
  lab.changed.on(refresh);
  lab.chosen.on(refresh);
  return h("label", { class: "choice" }, h("span", {}, label), select);
}
