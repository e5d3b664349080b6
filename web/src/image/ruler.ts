/** Depth scale with the focus caret, and the grey bar; both stand beside the image. */

import { s, set } from "../dom";
import type { Mapping } from "./fit";

export class Ruler {
  readonly scale = s("g", { class: "scale" });
  readonly caret = s("g", { class: "caret" }, s("path", { d: "M0 0l9-5.500v11z" }), s("rect", { x: -6, y: -12, width: 24, height: 24, class: "grab" }));
  private drawn = "";

  private x = 40;

  /** px from the left of the pane to the scale. */
  stand(x: number): void {
    this.x = x;
    this.drawn = "";
  }

  /** `skin` mm: where depth 0 lies in image coordinates; `depth` mm: how deep the image goes. */
  draw(map: Mapping, skin: number, depth: number, focus: number): void {
    const y = (mm: number) => map.point([0, skin + mm])[1];
    const key = `${y(0).toFixed(1)} ${y(depth).toFixed(1)} ${depth}`;
    if (key !== this.drawn) {
      this.drawn = key;
      this.scale.replaceChildren(...ticks(this.x, y, depth));
    }
    set(this.caret, { transform: `translate(${this.x + 8},${y(focus).toFixed(1)})` });
  }
}

function ticks(x: number, y: (mm: number) => number, depth: number): SVGElement[] {
  const every = depth > 60 ? 20 : 10;
  const fine = depth > 160 ? 10 : 5;
  const marks: SVGElement[] = [s("text", { class: "unit", x: x - 16, y: y(0) - 19, "text-anchor": "end" }, "cm")];
  for (let mm = 0; mm <= depth + 1e-6; mm += fine) {
    const long = mm % every === 0;
    marks.push(s("path", { d: `M${x - (long ? 11 : 6)} ${y(mm).toFixed(1)}H${x - (long ? 0 : 1)}` }));
    if (long) marks.push(s("text", { x: x - 16, y: (y(mm) + 4.5).toFixed(1), "text-anchor": "end" }, String(mm / 10)));
  }
  marks.push(s("rect", { class: "grab", x: 0, y: y(0).toFixed(1), width: x, height: Math.max(0, y(depth) - y(0)).toFixed(1) }));
  return marks;
}
