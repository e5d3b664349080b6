/** What an attempt came to, as tables for a spreadsheet. */

import type { Debrief } from "./protocol";

type Cell = string | number | boolean | null;

export function metricsTable({ metrics, exercise, seed, ended, passed }: Debrief): string {
  const head = ["exercise", "seed", "ended", "passed", "metric", "unit", "value", "least", "most", "reached", "expert mean", "expert deviation", "z"];
  return table(head, metrics.map((m) => [exercise.id, seed, ended, passed, m.name, m.unit, m.value, m.least, m.most, m.passed, m.band?.mean ?? null, m.band?.deviation ?? null, m.z]));
}

export function courseTable({ course }: Debrief): string {
  const axes = ["right", "deeper", "away"];
  const places = (["tip", "entry", "target"] as const).flatMap((name) => axes.map((axis) => `${name} ${axis} mm`));
  const head = ["time s", "depth mm", "out of plane mm", "half slice mm", "tip to target mm", "force N", ...places, "step"];
  const place = (p: readonly (number | null)[] | null): Cell[] => (p ? [...p] : [null, null, null]);
  return table(head, course.time_s.map((time, k) => [
    time, course.depth[k], course.out_of_plane[k], course.half_slice[k], course.to_target[k], course.force[k],
    ...place(course.tip[k]), ...place(course.entry[k]), ...place(course.target[k]), course.step[k],
  ]));
}

function table(head: readonly string[], rows: readonly (readonly Cell[])[]): string {
  return `${[head, ...rows].map((row) => row.map(cell).join(",")).join("\r\n")}\r\n`;
}

/** Text that a spreadsheet would take for a formula is text. */
function cell(value: Cell): string {
  if (value === null) return "";
  if (typeof value !== "string") return String(value);
  const safe = /^[=+\-@\t]/.test(value) ? `'${value}` : value;
  return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}

export function download(name: string, text: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}
