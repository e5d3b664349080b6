/** A displacement in words. */

const WORDS = [["left", "right"], ["shallower", "deeper"], ["towards you", "away"]] as const;

/** The two largest parts of a displacement in words. */
export function parts(moved: readonly number[] | null): string {
  if (!moved) return "";
  const named = moved.map((size, k) => ({ size: Math.abs(size), word: WORDS[k][size > 0 ? 1 : 0], place: k }));
  const largest = [...named].sort((a, b) => b.size - a.size).slice(0, 2);
  const kept = largest.filter(({ size }) => size >= 0.05).sort((a, b) => a.place - b.place);
  return kept.length ? kept.map(({ size, word }) => `${size.toFixed(1)} ${word}`).join(", ") : "at rest";
}
