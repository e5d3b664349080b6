/** Learning curves of an exercise: cumulative sums of failures between the two lines at which something is decided. */

import { h, s, write } from "../dom";
import { number } from "../metrics";
import type { CurveRow, Lab, Results } from "./lab";

/** px around the field. */
const LEFT = 40;
const RIGHT = 120;
const TOP = 14;
const BELOW = 24;

export class LearningCurves {
  private readonly svg = s("svg", { class: "learning-plot", role: "img" });
  private readonly about = h("span", {});
  private readonly list = h("ul", { class: "unseen", "aria-label": "Decisions" });
  private readonly select = h("select", { "aria-label": "Exercise of the learning curves" });
  private readonly field = h("div", { class: "field" }, this.svg);
  readonly element = h(
    "section",
    { class: "learning", "aria-labelledby": "learning-title" },
    h("div", { class: "panel-head" }, h("h2", { id: "learning-title" }, "Learning curves"), h("label", { class: "choice" }, this.select), this.about),
    this.field,
    this.list,
  );
  private size = { width: 0, height: 0 };

  constructor(
    private readonly lab: Lab,
    private readonly chosen: () => string | null,
  ) {
    this.select.addEventListener("change", () => lab.ask({ exercise: this.select.value }));
    new ResizeObserver(([entry]) => {
      this.size = { width: entry.contentRect.width, height: entry.contentRect.height };
      this.draw();
    }).observe(this.field);
    lab.found.on((results) => {
      const names = [...new Set([...results.exercises, ...(results.exercise ? [results.exercise] : [])])];
      this.select.replaceChildren(...names.map((name) => h("option", { value: name }, name)));
      this.select.value = results.exercise ?? "";
      this.select.hidden = names.length === 0;
      const percent = (share: number) => `${number(100 * share)} %`;
      write(this.about, `CUSUM, acceptable failures ${percent(results.acceptable)}, not acceptable ${percent(results.unacceptable)}`);
      this.list.replaceChildren(...results.curves.map((one) => h("li", {}, `${one.participant}: ${one.sums.length} attempts, ${one.decision}`)));
      this.draw();
    });
  }

  draw(): void {
    const { results } = this.lab;
    const { width, height } = this.size;
    if (!results || width < 1) return;
    const most = Math.max(5, ...results.curves.map(({ sums }) => sums.length));
    const all = results.curves.flatMap(({ sums }) => sums);
    const [low, high] = [1.15 * Math.min(results.lower, ...all), 1.15 * Math.max(results.upper, ...all)];
    const x = (attempt: number) => LEFT + ((width - LEFT - RIGHT) * attempt) / most;
    const y = (sum: number) => TOP + ((height - TOP - BELOW) * (high - sum)) / (high - low);
    const out: SVGElement[] = this.limits(results, width, y);
    out.push(s("path", { class: "zero", d: `M${LEFT} ${y(0).toFixed(1)}H${width - RIGHT}` }));
    out.push(s("text", { class: "scale", x: LEFT, y: height - 6 }, "attempt 1"), s("text", { class: "scale", x: width - RIGHT, y: height - 6, "text-anchor": "end" }, String(most)));
    const lit = results.curves.find(({ participant }) => participant === this.chosen()) ?? null;
    const order = [...results.curves.filter((one) => one !== lit), ...(lit ? [lit] : [])];
    for (const curve of order) out.push(...this.curve(curve, curve === lit, x, y));
    if (results.curves.length === 0) out.push(s("text", { class: "none", x: width / 2, y: height / 2, "text-anchor": "middle" }, "The curves begin with the first attempt that is kept"));
    this.svg.replaceChildren(...out);
    this.svg.setAttribute("aria-label", `Learning curves of ${results.curves.length} participants${results.exercise ? ` at ${results.exercise}` : ""}`);
  }

  private limits(results: Results, width: number, y: (sum: number) => number): SVGElement[] {
    const line = (name: string, className: string, at: number) => [
      s("path", { class: `limit ${className}`, d: `M${LEFT} ${y(at).toFixed(1)}H${width - RIGHT}` }),
      s("text", { class: `limit ${className}`, x: width - RIGHT + 8, y: (y(at) + 4).toFixed(1) }, name),
    ];
    return [...line("needs teaching", "above", results.upper), ...line("proficient", "below", results.lower)];
  }

  private curve({ participant, sums, decision }: CurveRow, lit: boolean, x: (k: number) => number, y: (sum: number) => number): SVGElement[] {
    const points = [0, ...sums].map((sum, k) => `${x(k).toFixed(1)} ${y(sum).toFixed(1)}`);
    const className = `curve ${decision.replace(" ", "-")}${lit ? " lit" : ""}`;
    const line = s("path", { class: className, d: `M${points.join("L")}` }, s("title", {}, `${participant}: ${decision}`));
    const end = s("text", { class: className, x: x(sums.length).toFixed(1), y: (y(sums.at(-1) ?? 0) - 9).toFixed(1), "text-anchor": "end" }, participant);
    return lit ? [line, end] : [line];
  }
}
