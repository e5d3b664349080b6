/** The five numbers: text at most ten times a second, the unrounded values in `data-value`. */

import { Caution } from "../caution";
import type { Desk } from "../desk";
import { h, toggle, write } from "../dom";
import { icon } from "../icons";
import { signless } from "../knobs";
import type { FrameHeader, Readouts as Values, Scene } from "../protocol";
import type { Session } from "../session";
import { parts } from "./words";

const EVERY = 100;
/** ms after which numbers of another model or target than is chosen are taken away. */
const APART = 300;
/** What stands in place of the needle's length where it goes no deeper. */
const ENDS: Partial<Record<string, string>> = { "end of needle": "End of needle", bone: "On bone" };
/** N at the end of the bar. */
const STRONGEST = 5;
/** Share of the needle that may be in before its end is near. */
const NEEDLE_END = 0.95;

/** Plus is towards the viewer: against the image's z, which points into the screen. */
export const towardsViewer = (values: Values): number => (values.out_of_plane === 0 ? 0 : -values.out_of_plane);
export const inPlane = (values: Values): boolean => Math.abs(values.out_of_plane) <= values.half_slice;
export const onTarget = (values: Values, scene: Scene): boolean =>
  values.tip_to_target <= scene.tolerance_mm;

/** To the right on the screen, deeper, away from the viewer. */
function asSeen([right, deeper, away]: Values["moved_parts"], mirrored: boolean): Values["moved_parts"] {
  return [mirrored ? -right : right, deeper, away];
}

interface Row { root: HTMLElement; number: HTMLOutputElement; unit: HTMLElement; note: HTMLElement }

export class ReadoutsPart {
  private readonly ring = h("span", { class: "ring", "aria-hidden": "true" });
  private readonly bar = h("span", { class: "mark" });
  private readonly slice = h("span", { class: "slice" });
  /** About the hub. */
  private readonly moment = h("span", { class: "note moment" });
  private readonly push = h("span", { class: "fill" });
  private readonly rows = {
    tip: row("tip-to-target", "Tip to target", this.ring),
    depth: row("depth", "Insertion depth"),
    moved: row("moved", "Target moved"),
    plane: row("out-of-plane", "Tip out of plane"),
    force: row("force", "Force", null, "N"),
  };
  readonly element = h(
    "section",
    { class: "readouts", "aria-label": "Read-outs" },
    ...Object.values(this.rows).map(({ root }) => root),
  );
  private readonly cautions = { depth: new Caution(1), plane: new Caution(1), folds: new Caution(0.5) };
  private writtenAt = -Infinity;
  private written = -1;
  private apartSince: number | null = null;

  constructor(
    private readonly session: Session,
    private readonly desk: Desk,
  ) {
    this.rows.plane.note.before(h("span", { class: "plane-bar", "aria-hidden": "true" }, this.slice, this.bar));
    this.rows.force.note.after(this.moment);
    this.rows.force.note.before(h("span", { class: "force-bar", "aria-hidden": "true" }, this.push));
    session.statusChanged.on((status) => {
      if (status === "lost" || status === "loading") this.blank();
      else this.written = -1;
    });
  }

  /** Once an animation frame. */
  tick(now: number): void {
    const { frame, scene, status } = this.session;
    if (!frame || !scene || (status !== "live" && status !== "frozen") || now - this.writtenAt < EVERY) return;
    this.apartSince = this.session.agrees ? null : (this.apartSince ?? now);
    if (this.apartSince !== null && now - this.apartSince > APART) return this.blank();
    const { readouts } = frame.header;
    if (!readouts) return this.blank();
    const amber = this.judge(readouts, scene, now);
    if (frame.header.frame === this.written && !amber) return;
    this.writtenAt = now;
    this.written = frame.header.frame;
    this.show(frame.header, readouts, scene);
  }

  private judge(readouts: Values, scene: Scene, now: number): boolean {
    const { depth, plane, folds } = this.cautions;
    const before = [depth.on, plane.on, folds.on];
    depth.update(readouts.depth / scene.needle.length_mm / NEEDLE_END, now);
    plane.update(Math.abs(readouts.out_of_plane) / Math.max(readouts.half_slice, 1e-6), now);
    folds.update(Number(readouts.folds), now);
    return [depth.on, plane.on, folds.on].some((on, k) => on !== before[k]);
  }

  private show(header: FrameHeader, values: Values, scene: Scene): void {
    const { tip, depth, moved, plane, force } = this.rows;
    const reached = onTarget(values, scene);
    number(tip, values.tip_to_target, false);
    write(tip.note, reached ? "On target" : `on target below ${scene.tolerance_mm.toFixed(1)} mm`);
    toggle(tip.root, "reached", reached);
    number(depth, values.depth, false);
    write(depth.note, ENDS[header.blocked ?? ""] ?? `of ${scene.needle.length_mm.toFixed(0)} mm`);
    toggle(depth.root, "caution", this.cautions.depth.on);
    number(moved, values.moved, false);
    write(moved.note, this.cautions.folds.on ? "the tissue folds" : parts(asSeen(values.moved_parts, this.desk.switches.mirrored)));
    toggle(moved.root, "caution", this.cautions.folds.on);
    number(plane, towardsViewer(values), true);
    const out = this.cautions.plane.on;
    write(plane.note, !out ? (inPlane(values) ? "in plane" : "") : towardsViewer(values) > 0 ? "sweep towards you" : "sweep away");
    toggle(plane.root, "caution", out);
    this.drawBar(values);
    number(force, values.hub?.axial_n ?? null, false);
    write(force.note, values.hub ? `${values.hub.lateral_n.toFixed(1)} N across` : "not in this model");
    write(this.moment, values.hub ? `, ${values.hub.moment_nmm.toFixed(0)} N mm` : "");
    this.drawPush(values.hub?.axial_n ?? 0);
  }

  /** From the middle: pushing to the right, pulling to the left. */
  private drawPush(newtons: number): void {
    const share = Math.min(1, Math.abs(newtons) / STRONGEST);
    this.push.style.left = `${(newtons < 0 ? 50 - 50 * share : 50).toFixed(2)}%`;
    this.push.style.width = `${(50 * share).toFixed(2)}%`;
  }

  /** The slice in the middle of a bar that spans six of its halves. */
  private drawBar(values: Values): void {
    const place = Math.min(1, Math.max(-1, towardsViewer(values) / (6 * values.half_slice)));
    this.bar.style.left = `${(50 + 50 * place).toFixed(2)}%`;
    this.slice.style.left = `${50 - 50 / 6}%`;
    this.slice.style.width = `${100 / 6}%`;
  }

  private blank(): void {
    this.written = -1;
    this.drawPush(0);
    write(this.moment, "");
    for (const { root, number, note } of Object.values(this.rows)) {
      write(number, "–");
      number.removeAttribute("data-value");
      write(note, "");
      root.classList.remove("caution", "reached");
    }
    for (const caution of Object.values(this.cautions)) caution.clear();
  }
}

function row(id: string, label: string, before: HTMLElement | null = null, of = "mm"): Row {
  const number = h("output", { class: "number", id: `read-${id}`, "aria-labelledby": `label-${id}`, "aria-live": "off" }, "–");
  const unit = h("span", { class: "unit" }, of);
  const note = h("span", { class: "note" });
  const name = h("h2", { class: "label", id: `label-${id}` }, before, label);
  const root = h("div", { class: `readout ${id}` }, name, h("p", { class: "value" }, number, unit), h("p", { class: "below" }, icon("warning", 12), note));
  return { root, number, unit, note };
}

function number({ number: output }: Row, value: number | null, signed: boolean): void {
  if (value === null) {
    write(output, "–");
    output.removeAttribute("data-value");
    return;
  }
  const text = signless(value.toFixed(1));
  write(output, signed && value > 0 && text !== "0.0" ? `+${text}` : text);
  output.dataset.value = value.toFixed(3);
}
