/** Locks guides, the model or hands, at the station that is watched or at all of them. */

import { h } from "../dom";
import type { Lab } from "./lab";

const HINTS = { guides: "Free practice without guides", models: "The model stays as it is", hands: "Time stands still, and nothing counts" } as const;

export function lockButton(lab: Lab, label: string, what: keyof typeof HINTS, all: boolean): HTMLElement {
  const button = h("button", { type: "button", class: "button toggle", "aria-pressed": "false", title: HINTS[what], disabled: true }, label);
  button.addEventListener("click", () => lab.say({ type: "lock_station", station: all ? null : lab.watched, what, on: button.getAttribute("aria-pressed") !== "true" }));
  const refresh = () => {
    const stations = lab.concerned(all);
    button.disabled = stations.length === 0;
    button.setAttribute("aria-pressed", String(stations.length > 0 && stations.every((one) => one[`${what}_locked`])));
  };
  lab.changed.on(refresh);
  lab.chosen.on(refresh);
  return button;
}
