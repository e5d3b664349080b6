/** This pass in four numbers; the place kept for exercises. */

import { h, write } from "../dom";
import type { Session } from "../session";

const EVERY = 100;

export class PassPanel {
  private readonly metrics = { time: metric("Time"), passes: metric("Passes"), path: metric("Tip path"), off: metric("Max off-plane") };
  readonly element = h(
    "section",
    { class: "panel pass", "aria-labelledby": "pass-title" },
    h("div", { class: "panel-head" }, h("h2", { id: "pass-title" }, "This pass"), h("span", {}, "no exercise running")),
    h("dl", {}, ...Object.values(this.metrics).map(({ root }) => root)),
  );
  private writtenAt = -Infinity;

  constructor(private readonly session: Session) {
    session.statusChanged.on((status) => {
      if (status === "lost" || status === "loading") for (const { value } of Object.values(this.metrics)) write(value, "–");
    });
  }

  tick(now: number): void {
    const { frame, status } = this.session;
    if (now - this.writtenAt < EVERY || !frame || status === "lost") return;
    this.writtenAt = now;
    const { time_s, passes, tip_path_mm, max_off_plane_mm } = frame.header.pass;
    const { time, passes: count, path, off } = this.metrics;
    write(time.value, `${Math.floor(time_s / 60)}:${String(Math.floor(time_s % 60)).padStart(2, "0")}`);
    write(count.value, String(passes));
    write(path.value, `${tip_path_mm.toFixed(0)} mm`);
    write(off.value, `${max_off_plane_mm.toFixed(1)} mm`);
  }
}

function metric(name: string): { root: HTMLElement; value: HTMLElement } {
  const value = h("dd", {}, "–");
  return { root: h("div", {}, h("dt", {}, name), value), value };
}
