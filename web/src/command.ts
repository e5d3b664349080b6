/** What the hand asks for, against what the server could do. */

import { AXES, read, type AxisId } from "./axes";
import type { State } from "./protocol";

type Part = Record<string, number>;
const GROUPS = ["needle", "probe", "image"] as const;
const SAME = 1e-6;

/**
 * Where the server did not follow a command (blocked, clamped, taken back), the hand is put there too.
 *
 * @param command what the hand wants now
 * @param sent the command that the frame answers
 * @param state what is in force: what the server made of it
 */
export function adopt(command: State, sent: State, state: State): State {
  let next = command;
  for (const group of GROUPS) {
    const changed: Part = {};
    for (const [field, value] of Object.entries(state[group] as unknown as Part)) {
      const asked = (sent[group] as unknown as Part)[field];
      if (Math.abs(asked - value) > SAME) changed[field] = value;
    }
    if (Object.keys(changed).length > 0) next = { ...next, [group]: { ...next[group], ...changed } };
  }
  return sent.frozen === state.frozen ? next : { ...next, frozen: state.frozen };
}

/** Which axes the server did not follow, and which way they were going. */
export function limited(sent: State, state: State): [AxisId, 1 | -1][] {
  return (Object.keys(AXES) as AxisId[]).flatMap((id): [AxisId, 1 | -1][] => {
    const beyond = read(sent, id) - read(state, id);
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
