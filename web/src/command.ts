/** What the hand asks for, against what the server could do. */

import { read } from "./knobs";
import type { Command, Knob } from "./protocol";

type Numbers = Record<string, number>;
const GROUPS = ["needle", "probe", "image"] as const satisfies readonly Knob["group"][];
const SAME = 1e-6;

/**
 * Where the server did not follow a command (blocked, clamped, taken back), the hand is put there too; one that has
 * turned back meanwhile, and is on this side of it already, stays where it is.
 *
 * @param command what the hand wants now
 * @param sent the command that the frame answers
 * @param state what is in force: what the server made of it
 */
export function adopt(command: Command, sent: Command, state: Command): Command {
  let next = command;
  for (const group of GROUPS) {
    const changed: Numbers = {};
    for (const [field, value] of Object.entries(state[group])) {
      const asked = (sent[group] as unknown as Numbers)[field];
      const now = (command[group] as unknown as Numbers)[field];
      if (asked - value > SAME) changed[field] = Math.min(now, value);
      else if (value - asked > SAME) changed[field] = Math.max(now, value);
    }
    if (Object.keys(changed).length > 0) next = { ...next, [group]: { ...next[group], ...changed } };
  }
  if (!alike(sent.tissue, state.tissue)) next = { ...next, tissue: state.tissue };
  return sent.frozen === state.frozen ? next : { ...next, frozen: state.frozen };
}

/** Which knobs the server did not follow, and which way they were going. */
export function limited(knobs: readonly Knob[], sent: Command, state: Command): [Knob, 1 | -1][] {
  return knobs.flatMap((knob): [Knob, 1 | -1][] => {
    const beyond = read(sent, knob) - read(state, knob);
    return Math.abs(beyond) > SAME ? [[knob, beyond > 0 ? 1 : -1]] : [];
  });
}

export function same(a: Command, b: Command): boolean {
  const parts = GROUPS.every((group) => {
    const [p, q] = [a[group] as unknown as Numbers, b[group] as unknown as Numbers];
    return p === q || Object.keys(p).every((field) => p[field] === q[field]);
  });
  return parts && alike(a.tissue, b.tissue) && a.frozen === b.frozen;
}

/** Whether tissue is asked for the same in time. */
function alike(a: Command["tissue"], b: Command["tissue"]): boolean {
  return a?.contact === b?.contact && a?.relaxation === b?.relaxation && a?.breathing === b?.breathing && a?.probe === b?.probe;
}
