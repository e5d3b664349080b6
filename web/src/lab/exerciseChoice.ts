/** Which exercise is to be done, at the station that is watched or at all of them. */

import { h } from "../dom";
import type { Lab } from "./lab";

export function exerciseChoice(lab: Lab, label: string, all: boolean): HTMLElement {
  const select = h("select", { "aria-label": label, disabled: true });
  select.addEventListener("change", () => lab.say({ type: "set_exercise", station: all ? null : lab.watched, exercise: select.value || null }));
  const refresh = () => {
    const found = new Set(lab.concerned(all).map(({ exercise_set }) => exercise_set));
    select.disabled = found.size === 0;
    if (document.activeElement !== select) select.value = (found.size === 1 && [...found][0]) || "";
  };
  lab.greeted.on(({ exercises }) => {
    select.replaceChildren(h("option", { value: "" }, "Free choice"), ...exercises.map(({ id, name }) => h("option", { value: id }, name)));
    refresh();
  });
  lab.changed.on(refresh);
  lab.chosen.on(refresh);
  return h("label", { class: "choice" }, h("span", {}, label), select);
}
