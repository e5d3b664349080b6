/** Marks with a black halo: colour alone on mid speckle cannot be seen. */

import { s, set } from "../dom";
import type { Point } from "./sector";

export class Stroke {
  readonly group: SVGGElement;
  private readonly paths: SVGPathElement[];

  constructor(className: string) {
    this.paths = [s("path", { class: "halo" }), s("path", { class: "line" })];
    this.group = s("g", { class: className }, ...this.paths);
  }

  draw(d: string): void {
    for (const path of this.paths) if (path.getAttribute("d") !== d) set(path, { d });
  }
}

const r1 = (x: number): string => x.toFixed(1);

export const at = ([x, y]: Point): string => `${r1(x)} ${r1(y)}`;

export function polyline(points: readonly Point[]): string {
  return points.length < 2 ? "" : `M${points.map(at).join("L")}`;
}

export function circle([x, y]: Point, r: number): string {
  return `M${r1(x - r)} ${r1(y)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`;
}
