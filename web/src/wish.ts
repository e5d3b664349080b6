/** What the hand wants, against what the server could do. */

import { AXES, read, type AxisId } from "./axes";
import type { State } from "./protocol";

type Part = Record<string, number>;
const GROUPS = ["needle", "probe", "image"] as const;
const SAME = 1e-6;

/**
 * Where the server did not follow a wish (blocked, clamped, taken back), the hand is put there too.
 *
 * @param wish what the hand wants now
 * @param sent the wish that the frame answers
 * @param force what the server made of it
 */
export function adopt(wish: State, sent: State, force: State): State {
  let next = wish;
  for (const group of GROUPS) {
    const changed: Part = {};
    for (const [field, value] of Object.entries(force[group] as unknown as Part)) {
      const asked = (sent[group] as unknown as Part)[field];
      if (Math.abs(asked - value) > SAME) changed[field] = value;
    }
    if (Object.keys(changed).length > 0) next = { ...next, [group]: { ...next[group], ...changed } };
  }
  return sent.frozen === force.frozen ? next : { ...next, frozen: force.frozen };
}

/** Which axes the server did not follow, and which way they were going. */
export function limited(sent: State, force: State): [AxisId, 1 | -1][] {
  return (Object.keys(AXES) as AxisId[]).flatMap((id): [AxisId, 1 | -1][] => {
    const beyond = read(sent, id) - read(force, id);
    return Math.abs(beyond) > SAME ? [[id, beyond > 0 ? 1 : -1]] : [];
  });
}

export function same(a: State, b: State): boolean {
  const parts = GROUPS.every((group) => {
    const [p, q] = [a[group] as unknown as Part, b[group] as unknown as Part];
    return p === q || Object.keys(p).every((field) => p[field] === q[field]);
  });
  return parts && a.frozen === b.frozen;
}
