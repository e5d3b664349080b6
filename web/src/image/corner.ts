/** How much room the black corners beside the sector have. Pure; px. */

import type { Point } from "./sector";

export type Side = "left" | "right";

/** px between a side of a pane and a polygon, where the pane is between two heights; all of the pane where it is not. */
export function roomBeside(outline: readonly Point[], side: Side, width: number, from: number, to: number): number {
  const xs = outline.flatMap((a, k) => within(a, outline[(k + 1) % outline.length], from, to));
  if (xs.length === 0) return width;
  return side === "left" ? Math.min(...xs) : width - Math.max(...xs);
}

/** The ends of the part of an edge that lies between two heights. */
function within([ax, ay]: Point, [bx, by]: Point, from: number, to: number): number[] {
  const [low, high] = [Math.max(from, Math.min(ay, by)), Math.min(to, Math.max(ay, by))];
  if (low > high) return [];
  if (ay === by) return [ax, bx];
  return [low, high].map((y) => ax + ((bx - ax) * (y - ay)) / (by - ay));
}
