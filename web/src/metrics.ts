/** Metrics in words, and numbers as people read them. */

import type { MeasuredMetric } from "./protocol";

const SUFFIXES = /_(s|mm|mm2|percent|deg|n|mm_s|mm_s3)$/;
const UNITS: Record<string, string> = { deg: "°", "mm^2": "mm²", "mm/s^3": "mm/s³" };

/** `blind_advance_mm` is "Blind advance". */
export function title(name: string): string {
  const words = name.replace(SUFFIXES, "").replaceAll("_", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

export function unitOf(unit: string): string {
  return UNITS[unit] ?? unit;
}

const NOTHING = 5e-4;

/** Counts whole, else three digits that count. */
export function number(value: number): string {
  if (Math.abs(value) < NOTHING) return "0";
  const text = Number.isInteger(value) || Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(2 + Number(Math.abs(value) >= 1));
  return (Number(text) === 0 ? "0" : text.includes(".") ? text.replace(/\.?0+$/, "") : text).replace("-", "−");
}

export function withUnit(value: number | null, unit: string): string {
  if (value === null) return "–";
  const of = unitOf(unit);
  return of ? `${number(value)}${of === "°" ? "" : " "}${of}` : number(value);
}

/** A mark as the briefing says it: at most 8 mm. */
export function wanted({ least, most, unit }: Pick<MeasuredMetric, "least" | "most" | "unit">): string {
  const parts: string[] = [];
  if (least !== null) parts.push(`at least ${withUnit(least, unit)}`);
  if (most !== null) parts.push(most === 0 ? "none" : `at most ${withUnit(most, unit)}`);
  return parts.join(", ");
}

/** Minutes and seconds. */
export function clock(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds + 1e-6));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}
