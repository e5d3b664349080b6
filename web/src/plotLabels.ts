/** Where the names of curves stand: near where each wants to be, never on one another. Pure; px. */

/** `wanted` heights from the most to the least important, each between `top` and `bottom`, `apart` from the others. */
export function standApart(wanted: readonly number[], top: number, bottom: number, apart: number): number[] {
  const taken: number[] = [];
  for (const want of wanted) {
    const near = Math.min(bottom, Math.max(top, want));
    const rows = [near, ...taken.flatMap((at) => [at - apart, at + apart])];
    const free = rows.filter((at) => at >= top && at <= bottom && taken.every((other) => Math.abs(other - at) >= apart - 1e-9));
    const nearest = free.sort((a, b) => Math.abs(a - near) - Math.abs(b - near));
    taken.push(nearest[0] ?? near);
  }
  return taken;
}
