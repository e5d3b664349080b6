/** What an attempt came to: its path, its metrics and its course; the first two share a place where there is little. */

import { h } from "../dom";
import type { Reel } from "../reel";
import type { Trainer } from "../trainer";
import { choose, radioKeys } from "./buttons";
import { MetricsTable } from "./metricsTable";
import { PathViews } from "./pathViews";
import { Timeline } from "./timeline";

export function debriefPanel(trainer: Trainer, reel: Reel): HTMLElement {
  const tabs = ["Metrics", "Path"].map((name, k) => h("button", { type: "button", role: "radio", onclick: () => turn(k) }, name));
  const group = h("div", { class: "segments debrief-tabs", role: "radiogroup", "aria-label": "Shown" }, ...tabs);
  const root = h("div", { class: "debrief" }, group, new PathViews(trainer, reel).element, new MetricsTable(trainer).element, new Timeline(trainer, reel).element);
  const turn = (k: number) => {
    tabs.forEach((tab, at) => choose(tab, at === k));
    root.classList.toggle("shows-path", k === 1);
  };
  radioKeys(group, () => tabs, turn);
  turn(0);
  return root;
}
