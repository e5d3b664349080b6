/** Displacements, and what stops a needle, in words. */

import type { FrameHeader } from "../protocol";

type Blocked = Pick<FrameHeader, "blocked" | "bone" | "held_by">;
const BLOCKED: Record<Exclude<NonNullable<FrameHeader["blocked"]>, "bone" | "held">, readonly [string, string]> = {
  "end of needle": ["End of needle", "All of it is in"],
  "leaves the tissue": ["Leaves the tissue", "The needle stops here"],
  "needle inside": ["Turns no further", "The tissue holds the needle: pull it out to turn it more"],
};

/** What is limited, and by what; null where nothing is. */
export function stopped({ blocked, bone, held_by }: Blocked): readonly [string, string] | null {
  if (blocked === null) return null;
  if (blocked === "held") return ["Turns no further", `${capital(plain(held_by ?? "tissue"))} would tear: turn it back, or pull it out`];
  return blocked === "bone" ? [spoken(bone), "The needle stops here: pull it back"] : BLOCKED[blocked];
}

function spoken(bone: string | null): string {
  const name = plain(bone ?? "bone");
  return name === "bone" ? "Bone" : `Bone: ${name}`;
}

/** A label as people call it: rib_left_8 is the left rib 8. */
function plain(label: string): string {
  const words = label.split(/[_\s]+/).filter(Boolean);
  const isSide = (word: string) => word === "left" || word === "right";
  return [...words.filter(isSide), ...words.filter((word) => !isSide(word))].join(" ");
}

const capital = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1);

/** An event as a title and the rest: punctured "renal capsule" at 1.2 N. None of bone, for what stops a needle is said already. */
export function happening(text: string): readonly [string, string] | null {
  const found = /^(\S+) "(.*)"(.*)$/.exec(text);
  if (found?.[1] === "touched") return null;
  const [title, rest] = found ? [found[1], `${found[2]}${found[3]}`] : [text, ""];
  return [capital(title), rest];
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
