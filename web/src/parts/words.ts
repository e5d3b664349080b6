/** Displacements, and what stops a needle, in words. */

import type { FrameHeader } from "../protocol";

type Blocked = Pick<FrameHeader, "blocked" | "bone">;
const BLOCKED: Record<Exclude<NonNullable<FrameHeader["blocked"]>, "bone">, readonly [string, string]> = {
  "end of needle": ["End of needle", "All of it is in"],
  "leaves the tissue": ["Leaves the tissue", "The needle stops here"],
  "needle inside": ["Turns no further", "The tissue holds the needle: pull it out to turn it more"],
};

/** What is limited, and by what; null where nothing is. */
export function stopped({ blocked, bone }: Blocked): readonly [string, string] | null {
  if (blocked === null) return null;
  return blocked === "bone" ? [spoken(bone), "The needle stops here: pull it back"] : BLOCKED[blocked];
}

/** A bone as people call it: rib_left_8 is the left rib 8. */
function spoken(bone: string | null): string {
  const words = (bone ?? "bone").split(/[_\s]+/).filter(Boolean);
  const isSide = (word: string) => word === "left" || word === "right";
  const name = [...words.filter(isSide), ...words.filter((word) => !isSide(word))].join(" ");
  return name === "bone" ? "Bone" : `Bone: ${name}`;
}

/** An event as a title and the rest: punctured "renal capsule" at 1.2 N. None of bone, for what stops a needle is said already. */
export function happening(text: string): readonly [string, string] | null {
  const found = /^(\S+) "(.*)"(.*)$/.exec(text);
  if (found?.[1] === "touched") return null;
  const [title, rest] = found ? [found[1], `${found[2]}${found[3]}`] : [text, ""];
  return [title.charAt(0).toUpperCase() + title.slice(1), rest];
}

const WORDS = [["left", "right"], ["shallower", "deeper"], ["towards you", "away"]] as const;

/** The two largest parts of a displacement in words. */
export function parts(moved: readonly number[] | null): string {
  if (!moved) return "";
  const named = moved.map((size, k) => ({ size: Math.abs(size), word: WORDS[k][size > 0 ? 1 : 0], place: k }));
  const largest = [...named].sort((a, b) => b.size - a.size).slice(0, 2);
  const kept = largest.filter(({ size }) => size >= 0.05).sort((a, b) => a.place - b.place);
  return kept.length ? kept.map(({ size, word }) => `${size.toFixed(1)} ${word}`).join(", ") : "at rest";
}
