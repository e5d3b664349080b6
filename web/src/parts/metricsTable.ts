/** The metrics of an attempt with the expert's band; what each is, at a click. */

import { h, write } from "../dom";
import { number, title, unitOf, wanted, withUnit } from "../metrics";
import type { MeasuredMetric } from "../protocol";
import type { Trainer } from "../trainer";

/** What a teacher looks at first; the others follow. */
const FIRST = [
  "final_error_mm", "passes", "redirections", "blind_advance_mm", "tip_in_plane_percent", "structures_hit", "back_wall_perforations",
  "needle_path_mm", "needle_path_economy_percent", "insertion_time_s", "time_s", "target_motion_mm", "tissue_swept_mm2", "peak_force_n", "probe_path_mm",
];

/** Measured in two ways: the second says its unit. */
const ALSO = ["blind_advance_percent", "structures_hit_mm"];

export class MetricsTable {
  private readonly band = h("span", {});
  private readonly rows = h("tbody", {});
  private readonly about = h("p", { class: "about", "aria-live": "polite" });
  readonly element = h(
    "section",
    { class: "measured", "aria-labelledby": "measured-title" },
    h("div", { class: "panel-head" }, h("h2", { id: "measured-title" }, "Metrics"), this.band),
    h("div", { class: "rows", tabindex: 0, role: "region", "aria-label": "Table of metrics" }, h("table", {}, h("thead", { class: "unseen" }, h("tr", {}, ...["Metric", "Value", "Deviations", "Band"].map((name) => h("th", { scope: "col" }, name)))), this.rows)),
    this.about,
  );

  constructor(trainer: Trainer) {
    trainer.changed.on(() => {
      const { debrief } = trainer;
      if (!debrief) return;
      const attempts = debrief.metrics.find(({ band }) => band)?.band?.attempts;
      write(this.band, attempts ? `band: ${attempts} attempts of a scripted expert` : "no expert band");
      this.band.title = debrief.band;
      const known = debrief.metrics.filter(({ value, least, most }) => value !== null || least !== null || most !== null);
      this.element.classList.toggle("no-band", !attempts);
      this.rows.replaceChildren(...[...known].sort((a, b) => rank(a) - rank(b)).map((metric) => this.row(metric)));
      write(this.about, "Choose a metric to read what it is.");
    });
  }

  private row(metric: MeasuredMetric): HTMLElement {
    const name = h("button", { type: "button", onclick: () => this.explain(metric) }, ALSO.includes(metric.name) ? `${title(metric.name)}, ${unitOf(metric.unit)}` : title(metric.name));
    const missed = metric.passed === false;
    const z = metric.z === null ? "" : `z ${number(Math.round(metric.z * 10) / 10)}`;
    return h(
      "tr",
      { class: missed ? "caution" : "" },
      h("th", { scope: "row" }, name),
      h("td", { class: "value" }, withUnit(metric.value, metric.unit), missed ? h("small", {}, wanted(metric)) : null),
      h("td", { class: "z" }, z),
      h("td", {}, bar(metric)),
    );
  }

  private explain(metric: MeasuredMetric): void {
    const { band } = metric;
    const unit = unitOf(metric.unit);
    const expert = band ? ` The expert: ${number(band.mean)} ± ${number(band.deviation)}${unit ? ` ${unit}` : ""}.` : "";
    const source = metric.source === "own" ? "" : ` Source: ${metric.source}.`;
    const asked = wanted(metric);
    write(this.about, `${title(metric.name)}: ${metric.definition}${asked ? ` Wanted: ${asked}.` : ""}${expert}${source}`);
  }
}

function rank({ name, least, most }: MeasuredMetric): number {
  const judged = least !== null || most !== null;
  const at = FIRST.indexOf(name);
  return (judged ? 0 : 100) + (at < 0 ? FIRST.length : at);
}

/** The expert's least to most as a band, and where this attempt lies. */
function bar({ value, band, better }: MeasuredMetric): HTMLElement {
  const root = h("span", { class: "band-bar", "aria-hidden": "true" });
  if (value === null || !band) return root;
  const low = Math.min(0, band.low, value);
  const wide = Math.max(band.high, value, better === "more" ? 100 : 0, 1e-9) - low;
  const at = (x: number) => (94 * (x - low)) / wide + 3;
  const inside = h("span", { class: "band" });
  inside.style.left = `${(at(band.low) - 2).toFixed(1)}%`;
  inside.style.width = `${(at(band.high) - at(band.low) + 4).toFixed(1)}%`;
  const mark = h("span", { class: "mark" });
  mark.style.left = `${at(value).toFixed(1)}%`;
  root.append(inside, mark);
  return root;
}
