/** The marks on the image: what the hand moves (accent) and where it wants to be (yellow). */

import { s, set, toggle, write } from "../dom";
import type { FrameHeader, Guide, NeedleCommand, Scene } from "../protocol";
import { toFrame, toWorld, type Vec } from "../vec";
import type { Mapping } from "./fit";
import { intoSight, needleInImage, pathAhead, reach, skinLine } from "./geometry";
import type { Point, Sector } from "./sector";
import { at, circle, polyline, Stroke } from "./strokes";

const HANDLE = 13;
const TIP = 11;
const TARGET = 15;
const PATH_TICK = 5;
/** px from the left that the depth scale takes. */
const SCALE = 62;
/** px of skin beyond the handle. */
const BEYOND = 34;
/** px of the pane's edge that the handle keeps clear of. */
const INSET = 18;

/** What of the marks may be shown, and how it stands. */
export interface Shown { allows: (guide: Guide) => boolean; inPlane: boolean; onTarget: boolean }

export class Marks {
  readonly svg = s("svg", { class: "marks", "aria-hidden": "true" });
  /** The ring on the skin line that is dragged. */
  readonly handle = s(
    "g",
    { class: "handle" },
    s("circle", { class: "halo", r: HANDLE }),
    s("circle", { class: "ring", r: HANDLE }),
    s("path", { class: "arrows" }),
    s("circle", { class: "grab", r: 26 }),
  );
  private readonly ghost = s("circle", { class: "ghost", r: HANDLE });
  private readonly waiting = s("path", { class: "waiting" });
  private readonly skin = new Stroke("skin");
  private readonly face = new Stroke("face");
  /** Where the needle may enter. */
  private readonly zone = new Stroke("zone");
  /** Of colour Doppler. */
  private readonly box = new Stroke("colour-box");
  private readonly dot = s("circle", { class: "dot", r: 5 });
  private readonly shaft = new Stroke("shaft");
  private readonly tip = new Stroke("tip");
  private readonly path = new Stroke("path");
  private readonly rest = new Stroke("rest");
  private readonly target = new Stroke("target");
  private readonly leader = new Stroke("leader");
  private readonly label = s("text", { class: "label" });
  private labelWidth = 0;
  private readonly tag = s("rect", { class: "tag", rx: 4 });
  private readonly guides = s("g", { class: "guides" });

  constructor() {
    this.guides.append(
      this.path.group, this.rest.group, this.target.group, this.leader.group, this.tag, this.label, this.tip.group,
    );
    this.svg.append(
      this.waiting, this.box.group, this.skin.group, this.zone.group, this.face.group, this.dot, this.guides, this.shaft.group, this.ghost, this.handle,
    );
  }

  /** The empty sector, before the first frame. */
  drawWaiting(map: Mapping, sector: Sector, origin: Point, waiting: boolean): void {
    const outline = sector.outline.map(([x, y]) => map.point([x + origin[0], y + origin[1]]));
    set(this.waiting, { d: waiting ? `${polyline(outline)}Z` : "" });
  }

  /** What belongs to the probe: its face, the skin beside it and the dot on its marked side. */
  drawProbe(map: Mapping, sector: Sector, header: FrameHeader, scene: Scene, paneWidth: number): void {
    const origin = faceOrigin(header);
    const face = sector.face.map(([x, y]) => map.point([x + origin[0], y + origin[1]]));
    const lifted = face.map(([x, y]): Point => [x, y - 5]);
    this.face.draw(polyline(lifted));
    const marked = lifted[0];
    const [left, right] = [marked, lifted[lifted.length - 1]].sort(([a], [b]) => a - b);
    set(this.dot, { cx: (marked[0] - 17 * map.sign).toFixed(1), cy: (marked[1] - 5).toFixed(1) });
    const skin = skinLine(scene.frame, header.image_to_reference);
    this.drawZone(map, header, scene);
    this.box.draw(header.colour ? polyline(header.colour.outline.map(([x, y]) => map.point([x + origin[0], y + origin[1]]))) : "");
    if (!skin) return this.skin.draw("");
    const onSkin = (x: number): Point => {
      const t = (map.back([x, 0])[0] - skin.through[0]) / (skin.along[0] || 1e-9);
      return map.point([skin.through[0] + t * skin.along[0], skin.through[1] + t * skin.along[1]]);
    };
    const reachOut = Math.min(0.16 * paneWidth, 170);
    const [entry] = map.point(needleInImage(scene.frame, header.state.needle, header.image_to_reference).entry);
    const [first, last] = [Math.min(left[0] - 0.6 * reachOut, entry - BEYOND), Math.max(right[0] + 0.6 * reachOut, entry + BEYOND)];
    const parts: Point[][] = [
      [onSkin(Math.min(left[0] - 6, Math.max(SCALE, first))), onSkin(left[0] - 6)],
      [onSkin(right[0] + 6), onSkin(Math.min(paneWidth - 8, last))],
    ];
    this.skin.draw(parts.map(polyline).join(""));
  }

  private drawZone(map: Mapping, header: FrameHeader, scene: Scene): void {
    const zone = scene.attempt?.exercise.zone;
    const end = (u: number): Point => {
      const [x, y] = map.point(needleInImage(scene.frame, { ...header.state.needle, u }, header.image_to_reference).entry);
      return [Math.max(SCALE, x), y];
    };
    this.zone.draw(zone ? polyline(zone.u.map(end)) : "");
  }

  /** The handle and the shaft outside the image answer the hand at once. `slid` mm: how far a drag has carried it. */
  drawHandle(map: Mapping, sector: Sector, header: FrameHeader, scene: Scene, pose: NeedleCommand, slid: number): Point {
    const needle = needleInImage(scene.frame, pose, header.image_to_reference);
    const origin = faceOrigin(header);
    const from: Point = [needle.entry[0] - origin[0], needle.entry[1] - origin[1]];
    const length = Math.max(pose.depth, 1) * needle.share;
    const seen = reach(sector.outline, from, needle.along, length);
    const step = (t: number) => map.point([needle.entry[0] + t * needle.along[0], needle.entry[1] + t * needle.along[1]]);
    const start = Math.max(slid * needle.share, intoSight(step(0), map.turned(needle.along), map.pane, INSET) / map.scale);
    const place = step(start);
    const edge = HANDLE / map.scale + start;
    this.shaft.draw(seen > edge ? polyline([step(edge), step(seen)]) : "");
    set(this.handle, { transform: `translate(${at(place).replace(" ", ",")})` });
    const arrows = this.handle.children[2];
    const degrees = (Math.atan2(needle.along[1], map.sign * needle.along[0]) * 180) / Math.PI;
    set(arrows, { d: "M-6 0H6M-6 0l3-3M-6 0l3 3M6 0l-3-3M6 0l-3 3", transform: `rotate(${degrees.toFixed(1)})` });
    return place;
  }

  /** Where the handle last stood in a frame, while the hand is more than a moment ahead. */
  drawGhost(place: Point | null): void {
    toggle(this.ghost, "shown", place !== null);
    if (place) set(this.ghost, { cx: place[0].toFixed(1), cy: place[1].toFixed(1) });
  }

  /** Tip, path and target come with the frame they belong to, those that may be shown. */
  drawGuides(map: Mapping, header: FrameHeader, name: string, shown: Shown, paneWidth: number): void {
    const project = (p: Vec): Point => map.point(toFrame(header.image_to_reference, p));
    const { needle, target } = header;
    const tip = needle && project(needle.tip);
    this.tip.draw(tip && shown.allows("tip") && header.state.needle.depth > 0 ? circle(tip, TIP) : "");
    toggle(this.tip.group, "out", !shown.inPlane);
    const ahead = needle && target && shown.allows("path") ? pathAhead(needle, target, PATH_TICK) : null;
    this.path.draw(tip && ahead ? this.route(tip, project(ahead.end), ahead.ticks.map(project)) : "");
    const aim = target && shown.allows("target");
    toggle(this.guides, "no-target", !aim);
    if (aim) this.drawTarget(project(target.now), project(target.rest), name, tip, shown.onTarget, paneWidth);
    else for (const stroke of [this.target, this.rest, this.leader]) stroke.draw("");
  }

  private drawTarget(now: Point, rest: Point, name: string, tip: Point | null, onTarget: boolean, paneWidth: number): void {
    this.rest.draw(circle(rest, TARGET - 2));
    const arms = [[1, 0], [-1, 0], [0, 1], [0, -1]].map(([x, y]) =>
      polyline([[now[0] + x * (TARGET - 5), now[1] + y * (TARGET - 5)], [now[0] + x * (TARGET + 5), now[1] + y * (TARGET + 5)]]),
    );
    this.target.draw(circle(now, TARGET) + circle(now, 1) + arms.join(""));
    toggle(this.target.group, "reached", onTarget);
    this.name(now, name, tip && tip[0] > now[0] ? -1 : 1, paneWidth);
  }

  private route(tip: Point, end: Point, ticks: Point[]): string {
    const [dx, dy] = [end[0] - tip[0], end[1] - tip[1]];
    const length = Math.hypot(dx, dy);
    if (length <= TIP) return "";
    const [ux, uy] = [dx / length, dy / length];
    const dashes: Point[][] = [];
    for (let t = TIP + 3; t < length; t += 8) dashes.push([along(t), along(Math.min(t + 4.5, length))]);
    const across = ticks
      .filter(([x, y]) => Math.hypot(x - tip[0], y - tip[1]) > TIP + 2)
      .map(([x, y]): Point[] => [[x - 4.5 * uy, y + 4.5 * ux], [x + 4.5 * uy, y - 4.5 * ux]]);
    return [...dashes, ...across].map(polyline).join("");

    function along(t: number): Point {
      return [tip[0] + t * ux, tip[1] + t * uy];
    }
  }

  /** The name stands on the side where the needle does not come from, if there is room. */
  private name(now: Point, name: string, wanted: 1 | -1, paneWidth: number): void {
    const wide = this.widthOf(name);
    const fits = (on: number) => now[0] + on * (58 + wide) > 8 && now[0] + on * (58 + wide) < paneWidth - 8;
    const side = fits(wanted) ? wanted : -wanted;
    const text: Point = [now[0] + side * 45 - (side < 0 ? wide : 0), now[1] - 29];
    set(this.label, { x: text[0].toFixed(1), y: text[1].toFixed(1) });
    set(this.tag, { x: (text[0] - 5).toFixed(1), y: (text[1] - 14).toFixed(1), width: (wide + 10).toFixed(1), height: 19 });
    const start: Point = [now[0] + side * 13, now[1] - 10];
    this.leader.draw(polyline([start, [now[0] + side * 39, now[1] - 27]]));
  }

  /** Measured when the name changes: to measure is to lay the page out. */
  private widthOf(name: string): number {
    if (this.label.textContent !== name) {
      write(this.label, name);
      this.labelWidth = name ? this.label.getComputedTextLength() : 0;
    }
    return this.labelWidth;
  }
}

/** The middle of the probe's face in image coordinates. */
export function faceOrigin(header: FrameHeader): Point {
  const [x, y] = toFrame(header.image_to_reference, toWorld(header.probe_to_reference, [0, 0, 0]));
  return [x, y];
}
