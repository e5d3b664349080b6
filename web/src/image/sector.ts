/** The outline of what a probe sees, in the probe's coordinates: x right, y deep, origin in the middle of its face; mm. */

import type { ProbeOutline } from "../protocol";

export type Point = readonly [number, number];

export interface Sector {
  /** The transducer's face, left to right; one point where all beams start there. */
  face: Point[];
  /** The deep end, left to right. */
  deep: Point[];
  /** Face, right edge, deep end, left edge. */
  outline: Point[];
  low: Point;
  high: Point;
}

const SAME = 1e-6;

export function sector({ beams }: ProbeOutline, depth: number): Sector {
  const ends = beams.map(([x, y]): Point => [x, y]);
  const face = ends.every(([x, y]) => Math.hypot(x - ends[0][0], y - ends[0][1]) < SAME) ? [ends[0]] : ends;
  const deep = beams.map(([x, y, dx, dy]): Point => [x + depth * dx, y + depth * dy]);
  const outline = [...face, ...[...deep].reverse()];
  const xs = outline.map(([x]) => x);
  const ys = outline.map(([, y]) => y);
  return {
    face,
    deep,
    outline,
    low: [Math.min(...xs), Math.min(...ys)],
    high: [Math.max(...xs), Math.max(...ys)],
  };
}

/** Whether the beams run side by side: then the image fills its corners. */
export function parallel({ beams }: ProbeOutline): boolean {
  const [first, last] = [beams[0], beams[beams.length - 1]];
  return Math.hypot(first[2] - last[2], first[3] - last[3]) < SAME;
}
